#include "stipple/proto/problem.hpp"

#include "documents.hpp"

#include <gtest/gtest.h>

namespace stipple::proto {
namespace {

TEST(Problem, HasTheStatusOfItsErrorCode) {
    const std::pair<ErrorCode, int> expected[] = {
        {ErrorCode::InvalidArgument, 400},   {ErrorCode::MalformedInput, 422},
        {ErrorCode::UnsupportedFormat, 415}, {ErrorCode::TooLarge, 413},
        {ErrorCode::NotFound, 404},          {ErrorCode::Conflict, 409},
        {ErrorCode::QueueFull, 429},         {ErrorCode::Internal, 500},
    };
    for (const auto& [code, status] : expected) {
        const Problem problem = problem_from(code, "why");
        EXPECT_EQ(problem.status, status);
        EXPECT_EQ(problem.type, kProblemBase + std::string(to_string(code)));
        EXPECT_EQ(problem.detail, "why");
        EXPECT_FALSE(problem.title.empty());
    }
}

TEST(Problem, BecomesTheErrorItCameFrom) {
    for (const ErrorCode code :
         {ErrorCode::InvalidArgument, ErrorCode::MalformedInput, ErrorCode::UnsupportedFormat,
          ErrorCode::TooLarge, ErrorCode::NotFound, ErrorCode::Conflict, ErrorCode::QueueFull,
          ErrorCode::Internal}) {
        const Error error = error_from(problem_from(code, "why"));
        EXPECT_EQ(error.code(), code);
        EXPECT_STREQ(error.what(), "why");
    }
}

TEST(Problem, OfAStatusWithoutAnErrorHasATypeOfItsOwn) {
    EXPECT_EQ(problem_from_status(401, "").type, std::string(kProblemBase) + "unauthorized");
    EXPECT_EQ(problem_from_status(507, "").type, std::string(kProblemBase) + "storage-full");
    EXPECT_EQ(problem_from_status(431, "").status, 431);
}

TEST(Problem, OfAnUnknownStatusKeepsTheStatusAndTellsWhoseFaultItIs) {
    EXPECT_EQ(problem_from_status(418, "").type, std::string(kProblemBase) + "invalid-argument");
    EXPECT_EQ(problem_from_status(418, "").status, 418);
    EXPECT_EQ(problem_from_status(599, "").type, std::string(kProblemBase) + "internal");
}

TEST(Problem, TravelsAsTheGoldenFileSays) {
    Problem problem = problem_from(ErrorCode::QueueFull, "1000 jobs are queued");
    problem.retry_after = 5;
    problem.stage = "decode";
    EXPECT_EQ(to_json(problem), test::golden("problem.json"));
    EXPECT_EQ(to_json(problem_from_json(to_json(problem))), to_json(problem));
}

TEST(Problem, SaysWhichCandidateItIsAbout) {
    const Error error(ErrorCode::MalformedInput, "the file holds no points");
    EXPECT_EQ(to_json(problem_from(error)).find("candidate"), std::string::npos);
    const Problem problem = problem_from(CandidateError(2, error));
    EXPECT_EQ(problem.detail, error.what());
    EXPECT_EQ(problem_from_json(to_json(problem)).candidate, 2U);
}

TEST(Problem, OfAFullDiskHasATypeOfItsOwn) {
    const Problem full = problem_from(StorageFull("no space for scan.ply"));
    EXPECT_EQ(full.status, 507);
    EXPECT_NE(to_json(full).find(R"("retryable":true)"), std::string::npos);
    EXPECT_EQ(full.type, std::string(kProblemBase) + "storage-full");
    EXPECT_EQ(full.detail, "storage full: no space for scan.ply");
    EXPECT_EQ(problem_from(Error(ErrorCode::NotFound, "gone")).status, 404);
}

TEST(Problem, WithBytesThatAreNoUtf8IsStillWritten) {
    const std::string text = to_json(problem_from(ErrorCode::MalformedInput, "name \xff"));
    EXPECT_EQ(problem_from_json(text).detail, "name \xEF\xBF\xBD");
}

TEST(Problem, ThatIsMalformedIsRefusedByField) {
    EXPECT_EQ(test::refusal(problem_from_json, R"({"type":"x"})", ErrorCode::MalformedInput),
              "title: missing: this field is required");
    EXPECT_EQ(test::refusal(problem_from_json, R"({"type":"x","title":"y","status":"200"})",
                            ErrorCode::MalformedInput),
              "status: \"200\": expected an integer of 100 to 599");
}

}  // namespace
}  // namespace stipple::proto
