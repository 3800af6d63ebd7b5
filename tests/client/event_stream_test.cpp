#include "event_stream.hpp"

#include <gtest/gtest.h>
#include <vector>

namespace stipple {
namespace {

using Events = std::vector<EventStreamParser::Event>;

Events parse(std::string_view stream, std::size_t piece = 1'000'000) {
    Events events;
    EventStreamParser parser([&](const auto& event) { events.push_back(event); });
    for (std::size_t at = 0; at < stream.size(); at += piece) parser.feed(stream.substr(at, piece));
    return events;
}

TEST(EventStreamParser, GivesIdTypeAndData) {
    const Events events = parse("id: 7\nevent: progress\ndata: {\"percent\": 5}\n\n");
    ASSERT_EQ(events.size(), 1U);
    EXPECT_EQ(events[0].id, "7");
    EXPECT_EQ(events[0].type, "progress");
    EXPECT_EQ(events[0].data, "{\"percent\": 5}");
}

TEST(EventStreamParser, JoinsLinesOfData) {
    const Events events = parse("data: a\ndata:b\ndata\n\n");
    ASSERT_EQ(events.size(), 1U);
    EXPECT_EQ(events[0].data, "a\nb\n");
    EXPECT_EQ(events[0].type, "message");
}

TEST(EventStreamParser, KeepsTheIdButNotTheTypeForTheNextEvent) {
    const Events events = parse("id: 1\nevent: level\ndata: x\n\ndata: y\n\n");
    ASSERT_EQ(events.size(), 2U);
    EXPECT_EQ(events[1].id, "1");
    EXPECT_EQ(events[1].type, "message");
}

TEST(EventStreamParser, PassesOverHeartbeatsUnknownFieldsAndEventsWithoutData) {
    EXPECT_TRUE(parse(": still here\n\nretry: 1000\nevent: status\n\nnonsense: 1\n\n").empty());
}

TEST(EventStreamParser, DoesNotGiveAnEventThatWasCutOff) {
    EXPECT_TRUE(parse("data: half").empty());
    EXPECT_TRUE(parse("data: half\n").empty());
}

TEST(EventStreamParser, GivesTheSameEventsForPiecesOfAnySizeAndAnyLineEnd) {
    for (const std::string end : {"\n", "\r", "\r\n"}) {
        std::string stream = "\xEF\xBB\xBF";
        for (const char* line :
             {"id: 1", "event: a", "data: one", "", ": beat", "", "id: 2", "data: two", ""})
            stream += line + end;
        for (std::size_t piece = 1; piece <= stream.size(); ++piece) {
            const Events events = parse(stream, piece);
            ASSERT_EQ(events.size(), 2U) << piece;
            EXPECT_EQ(events[0].id + events[0].type + events[0].data, "1aone");
            EXPECT_EQ(events[1].id + events[1].type + events[1].data, "2messagetwo");
        }
    }
}

}  // namespace
}  // namespace stipple
