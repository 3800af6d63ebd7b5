// Holds the program and openapi.yaml together.
#include "http/api.hpp"
#include "http/routes.hpp"
#include "stipple/proto/job_request.hpp"

#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>
#include <algorithm>
#include <filesystem>
#include <set>
#include <string>
#include <utility>

namespace stipple::server::http {
namespace {

YAML::Node document() {
    return YAML::LoadFile((std::filesystem::path(STIPPLE_SOURCE_DIR) / "openapi.yaml").string());
}

using Operation = std::pair<std::string, std::string>;

std::set<Operation> documented_operations() {
    std::set<Operation> operations;
    for (const auto& path : document()["paths"]) {
        for (const auto& operation : path.second) {
            std::string method = operation.first.as<std::string>();
            std::ranges::transform(method, method.begin(),
                                   [](unsigned char c) { return std::toupper(c); });
            operations.emplace(method, path.first.as<std::string>());
        }
    }
    return operations;
}

std::string scope_name(Scope scope) {
    return scope == Scope::Read ? "read" : scope == Scope::Submit ? "submit" : "";
}

TEST(OpenApi, DescribesExactlyTheRoutesThatAreServed) {
    std::set<Operation> served;
    for (const Route& route : routes()) served.emplace(route.method, route.path);
    EXPECT_EQ(served, documented_operations());
}

TEST(OpenApi, NamesTheScopeOfEveryRoute) {
    const YAML::Node paths = document()["paths"];
    for (const Route& route : routes()) {
        std::string method(route.method);
        std::ranges::transform(method, method.begin(),
                               [](unsigned char c) { return std::tolower(c); });
        const YAML::Node operation = paths[std::string(route.path)][method];
        const std::string scope =
            operation["x-scope"] ? operation["x-scope"].as<std::string>() : "";
        EXPECT_EQ(scope, scope_name(route.scope)) << route.method << ' ' << route.path;
        // A route without a scope is open, and says so.
        EXPECT_EQ(scope.empty(), operation["security"].IsDefined())
            << route.method << ' ' << route.path;
    }
}

TEST(OpenApi, ListsExactlyTheProblemTypesThatCanBeSent) {
    std::set<std::string> sent;
    for (int status = 400; status < 600; ++status)
        sent.insert(proto::problem_from_status(status, "").type);
    for (const ErrorCode code :
         {ErrorCode::InvalidArgument, ErrorCode::MalformedInput, ErrorCode::UnsupportedFormat,
          ErrorCode::TooLarge, ErrorCode::NotFound, ErrorCode::Conflict, ErrorCode::QueueFull,
          ErrorCode::Internal}) {
        sent.insert(proto::problem_from(code, "").type);
    }
    std::set<std::string> listed;
    for (const auto& type :
         document()["components"]["schemas"]["Problem"]["properties"]["type"]["enum"]) {
        listed.insert(type.as<std::string>());
    }
    EXPECT_EQ(sent, listed);
}

TEST(OpenApi, TellsThatACloudMayTurnOutToHaveNoPoints) {
    for (const char* path : {"/v1/jobs", "/v1/simplify", "/v1/evaluations"})
        EXPECT_TRUE(document()["paths"][path]["post"]["responses"]["422"].IsDefined()) << path;
    const YAML::Node empty = YAML::Load(proto::to_json(proto::CloudStatistics{}));  // JSON is YAML
    for (const auto& field : document()["components"]["schemas"]["CloudStatistics"]["required"])
        EXPECT_TRUE(empty[field.as<std::string>()].IsDefined()) << field;
    const YAML::Node source =
        YAML::LoadFile((std::filesystem::path(STIPPLE_SOURCE_DIR) / "proto/manifest.schema.json")
                           .string())["properties"]["source"];
    EXPECT_EQ(source["properties"]["points"]["minimum"].as<int>(), 0);
    for (const auto& field : source["required"])
        EXPECT_TRUE(field.Scalar() == "sha256" || empty[field.Scalar()].IsDefined()) << field;
}

const std::string kCandidate = R"(,"candidate":")" + std::string(64, 'b') + '"';

proto::JobRequest request_of(const std::string& type, const std::string& target) {
    const std::string input = type == "evaluate" ? "reference" : "input";
    return proto::job_request_from_json(R"({"type": ")" + type + R"(", ")" + input + R"(": ")" +
                                        std::string(64, 'a') + '"' + target + "}");
}

/// The fields of a request with everything in it that has a default, and what has none.
std::set<std::string> fields_of(const std::string& type, const std::string& target,
                                std::set<std::string> optional) {
    const auto request = request_of(type, target);
    const YAML::Node canonical = YAML::Load(proto::to_json(request));  // JSON is YAML
    for (const auto& field : canonical) optional.insert(field.first.as<std::string>());
    return optional;
}

std::set<std::string> documented_fields(const std::string& schema) {
    std::set<std::string> names;
    for (const auto& field : document()["components"]["schemas"][schema]["properties"])
        names.insert(field.first.as<std::string>());
    return names;
}

TEST(OpenApi, ListsExactlyTheFieldsOfEveryRequest) {
    std::set<std::string> simplify;
    for (const Method method : kMethods) {
        simplify.merge(fields_of("simplify",
                                 R"(,"points":9,"method":")" + std::string(to_string(method)) + '"',
                                 {"ratio", "max_error", "remove_outliers"}));
    }
    for (const proto::MethodField& field : proto::method_fields())
        simplify.insert(std::string(field.name));
    EXPECT_EQ(documented_fields("SimplifyRequest"), simplify);
    std::set<std::string> curve = {"max_displacement", "remove_outliers"};
    for (const Method method : kErrorBoundedMethods) {
        curve.merge(fields_of("curve", R"(,"method":")" + std::string(to_string(method)) + '"',
                              {"points"}));
    }
    EXPECT_EQ(documented_fields("CurveRequest"), curve);
    EXPECT_EQ(documented_fields("UpsampleRequest"),
              fields_of("upsample", R"(,"points":9)", {"ratio", "remove_outliers"}));
    EXPECT_EQ(documented_fields("AnalyzeRequest"),
              fields_of("analyze", "", {"viewpoint", "feature_lines", "remove_outliers"}));
    std::set<std::string> pyramid = {"max_displacement", "max_variation", "remove_outliers"};
    for (const Method method : kMethods) {
        pyramid.merge(fields_of("pyramid", R"(,"method":")" + std::string(to_string(method)) + '"',
                                {"levels", "base_bytes"}));
    }
    EXPECT_EQ(documented_fields("PyramidRequest"), pyramid);
    EXPECT_EQ(documented_fields("EvaluateRequest"),
              fields_of("evaluate", kCandidate, {"candidate", "range"}));
}

TEST(OpenApi, TellsTheDefaultsOfEveryRequest) {
    const auto compare = [](const char* schema, const std::string& type,
                            const std::string& target) {
        const auto request = request_of(type, target);
        const YAML::Node written = YAML::Load(proto::to_json(request));
        for (const auto& field : document()["components"]["schemas"][schema]["properties"]) {
            const YAML::Node expected = field.second["default"];
            const YAML::Node found = written[field.first.as<std::string>()];
            if (!expected.IsDefined() || !found.IsDefined() || !expected.IsScalar()) continue;
            double a = 0, b = 0;
            const bool numbers = YAML::convert<double>::decode(expected, a) &&
                                 YAML::convert<double>::decode(found, b);
            if (numbers) {
                EXPECT_EQ(a, b) << schema << ' ' << field.first;
            } else {
                EXPECT_EQ(expected.Scalar(), found.Scalar()) << schema << ' ' << field.first;
            }
        }
    };
    for (const Method method : kMethods) {
        compare("SimplifyRequest", "simplify",
                R"(,"points":9,"method":")" + std::string(to_string(method)) + '"');
    }
    compare("UpsampleRequest", "upsample", R"(,"points":9)");
    compare("AnalyzeRequest", "analyze", "");
    compare("PyramidRequest", "pyramid", "");
    compare("EvaluateRequest", "evaluate", kCandidate);
}

TEST(OpenApi, ListsTheMethodsInTheirOrder) {
    std::vector<std::string> listed, methods;
    for (const auto& method : document()["components"]["schemas"]["Method"]["enum"])
        listed.push_back(method.as<std::string>());
    for (const Method method : kMethods) methods.emplace_back(to_string(method));
    EXPECT_EQ(listed, methods);
}

TEST(OpenApi, HasEverythingThatItRefersTo) {
    std::set<std::string> dangling;
    const YAML::Node root = document();
    const auto visit = [&](const auto& self, const YAML::Node& node) -> void {
        if (node.IsMap()) {
            for (const auto& entry : node) {
                if (entry.first.Scalar() == "$ref") {
                    std::istringstream parts(entry.second.Scalar().substr(2));
                    YAML::Node found = root;
                    for (std::string part; found.IsDefined() && std::getline(parts, part, '/');) {
                        const YAML::Node next = static_cast<const YAML::Node&>(found)[part];
                        if (!next.IsDefined()) dangling.insert(entry.second.Scalar());
                        if (!next.IsDefined()) break;
                        found.reset(next);
                    }
                }
                self(self, entry.second);
            }
        } else if (node.IsSequence()) {
            for (const auto& item : node) self(self, item);
        }
    };
    visit(visit, root);
    EXPECT_EQ(dangling, std::set<std::string>());
}

TEST(FailureReply, TellsAFullDiskFromOtherFailures) {
    const auto status_of = [](const auto& failure) {
        return failure_reply(std::make_exception_ptr(failure), Request{}).status;
    };
    EXPECT_EQ(status_of(proto::StorageFull("no space")), 507);
    EXPECT_EQ(status_of(Error(ErrorCode::Internal, "storage full: only the words")), 500);
    EXPECT_EQ(status_of(Error(ErrorCode::NotFound, "no such job")), 404);
}

TEST(OpenApi, ListsTheFormatsThatCanBeUploaded) {
    std::vector<std::string> documented, taken;
    for (const auto& name : document()["components"]["schemas"]["CloudFormat"]["enum"])
        documented.push_back(name.as<std::string>());
    for (const CloudFormat format : kReadFormats) taken.emplace_back(to_string(format));
    EXPECT_EQ(documented, taken);
}

TEST(RouteTable, PrefersALiteralPathToAPlaceholder) {
    EXPECT_EQ(find_route("GET", "/v1/pyramids/7/manifest.json").route->handle, &get_manifest);
    EXPECT_EQ(find_route("GET", "/v1/pyramids/7/ab.drc").route->handle, &get_pyramid_file);
}

TEST(RouteTable, TakesThePlaceholdersOutOfThePath) {
    const RouteMatch match = find_route("GET", "/v1/jobs/7/results/ab.ply");
    EXPECT_EQ(match.values.at("id"), "7");
    EXPECT_EQ(match.values.at("file"), "ab.ply");
}

TEST(RouteTable, AnswersHeadWhereGetIsAnswered) {
    EXPECT_EQ(find_route("HEAD", "/v1/limits").route->handle, &get_limits);
}

TEST(RouteTable, NamesTheMethodsOfAPathThatTakesOthers) {
    const RouteMatch match = find_route("PUT", "/v1/clouds/7");
    EXPECT_EQ(match.route, nullptr);
    EXPECT_EQ(match.allow, "GET, HEAD, DELETE, OPTIONS");
}

TEST(RouteTable, KnowsNoOtherPath) {
    for (const char* path : {"/v1", "/v1/", "/v1/clouds/", "/v1/clouds//content",
                             "/v1/jobs/7/results/a/b", "//", "/assets/"}) {
        EXPECT_EQ(find_route("GET", path).same_path, nullptr) << path;
    }
}

}  // namespace
}  // namespace stipple::server::http
