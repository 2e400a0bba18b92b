#include "core/base/trace_context.h"

#include <set>
#include <string>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace isoscope::base {
namespace {

using ::testing::EndsWith;
using ::testing::MatchesRegex;
using ::testing::StartsWith;

constexpr char kTraceId[] = "4bf92f3577b34da6a3ce929d0e0e4736";
constexpr char kSampled[] = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01";

TEST(TraceContextTest, TheExampleOfTheStandardIsTaken) {
  const auto context = TraceContext::Parse(kSampled);
  ASSERT_TRUE(context.has_value());
  EXPECT_EQ(context->request_id(), kTraceId);
}

TEST(TraceContextTest, AnotherProcessGetsTheSameTraceIdAndFlagButANewParentId) {
  const auto context = TraceContext::Parse(kSampled);
  ASSERT_TRUE(context.has_value());
  std::set<std::string> made;
  for (int i = 0; i < 100; ++i) {
    const std::string traceparent = context->MakeTraceparent();
    EXPECT_THAT(traceparent, StartsWith(absl::StrCat("00-", kTraceId, "-")));
    EXPECT_THAT(traceparent, EndsWith("-01"));
    ASSERT_TRUE(TraceContext::Parse(traceparent).has_value()) << traceparent;
    made.insert(traceparent);
  }
  EXPECT_EQ(made.size(), 100u);
  EXPECT_THAT(TraceContext::Parse("00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-fe")
                  ->MakeTraceparent(),
              EndsWith("-00"));  // only the lowest flag is known
}

TEST(TraceContextTest, WhatTheStandardSaysToIgnoreIsIgnored) {
  for (const char* bad : {
           "",
           "00",
           "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-0",     // short
           "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-011",   // long
           "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01-x",  // version 00 has no more
           "00-4BF92F3577B34DA6A3CE929D0E0E4736-00f067aa0ba902b7-01",    // capitals
           "00-4bf92f3577b34da6a3ce929d0e0e473g-00f067aa0ba902b7-01",    // no digit
           "00-00000000000000000000000000000000-00f067aa0ba902b7-01",
           "00-4bf92f3577b34da6a3ce929d0e0e4736-0000000000000000-01",
           "ff-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01",
           "00_4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01",
           "00-4bf92f3577b34da6a3ce929d0e0e4736_00f067aa0ba902b7-01",
           "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7_01",
           "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-0\n",
           "01-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01x",
           " 00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01",
       }) {
    EXPECT_FALSE(TraceContext::Parse(bad).has_value()) << bad;
  }
  const std::string with_zero("00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-0\0", 55);
  EXPECT_FALSE(TraceContext::Parse(with_zero).has_value());
}

TEST(TraceContextTest, ALaterVersionMaySayMoreBehindADash) {
  for (const char* later : {"01-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01",
                            "cc-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01-what-comes"}) {
    const auto context = TraceContext::Parse(later);
    ASSERT_TRUE(context.has_value()) << later;
    EXPECT_EQ(context->request_id(), kTraceId);
    EXPECT_THAT(context->MakeTraceparent(), StartsWith("00-"));
  }
}

TEST(TraceContextTest, NewOnesAreWellFormedAndDiffer) {
  std::set<std::string> ids;
  for (int i = 0; i < 1000; ++i) {
    const TraceContext context = TraceContext::Random();
    EXPECT_THAT(context.request_id(), MatchesRegex("[0-9a-f]+"));
    EXPECT_EQ(context.request_id().size(), 32u);
    ASSERT_TRUE(TraceContext::Parse(context.MakeTraceparent()).has_value());
    ids.insert(context.request_id());
  }
  EXPECT_EQ(ids.size(), 1000u);
  EXPECT_NE(TraceContext::ParseOrRandom("nonsense").request_id(), "");
  EXPECT_EQ(TraceContext::ParseOrRandom(kSampled).request_id(), kTraceId);
}

}  // namespace
}  // namespace isoscope::base
