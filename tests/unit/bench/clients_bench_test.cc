#include "bench/clients_bench.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

namespace isoscope::bench {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

std::vector<ClientsRound> Rounds() {
  ClientsRound few;
  few.client_count = 4;
  few.frame_count = 600;
  few.frames_per_second = 40;
  few.p50_ms = 90;
  few.p99_ms = 120;
  few.most_frames = 151;
  few.least_frames = 149;
  ClientsRound many = few;
  many.client_count = 64;
  many.refusal_count = 77;
  many.retry_count = 76;
  return {few, many};
}

TEST(ClientsBenchTest, TheTextHasARowForEachRound) {
  const std::string text = DescribeClientsBench(Rounds());
  EXPECT_THAT(text, HasSubstr("      4      40.0        90         0       120"));
  EXPECT_THAT(text, HasSubstr("149 to 151"));
  EXPECT_THAT(text, HasSubstr("77        76      0      0\n"));
  EXPECT_THAT(text, Not(HasSubstr("error")));
}

TEST(ClientsBenchTest, TheFirstErrorOfARoundIsSaid) {
  std::vector<ClientsRound> rounds = Rounds();
  rounds[1].failed_count = 3;
  rounds[1].first_error = "UNAVAILABLE: gone";
  EXPECT_THAT(DescribeClientsBench(rounds),
              HasSubstr("64 clients, first error: UNAVAILABLE: gone"));
}

TEST(ClientsBenchTest, TheJsonHasTheSameFigures) {
  ClientsBenchPlan plan;
  plan.session.server = "localhost:50051";
  plan.request.isovalue = 60;
  const auto json = nlohmann::json::parse(ClientsBenchJson({}, plan, Rounds()));
  EXPECT_EQ(json["isovalues"][0], 60);
  EXPECT_EQ(json["seconds"], 15);
  EXPECT_EQ(json["rounds"][1]["clients"], 64);
  EXPECT_EQ(json["rounds"][1]["refusals"], 77);
  EXPECT_EQ(json["rounds"][0]["p99_ms"], 120);
}

}  // namespace
}  // namespace isoscope::bench
