#include "client-cli/commands/view_command.h"

#include <limits>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "client-cli/commands/program.h"
#include "core/cli/usage.h"

namespace isoscope::cli {
namespace {

using ::testing::HasSubstr;
namespace v1 = isoscope::v1;

TEST(ViewCommandTest, BeginsWithTheLevelBetweenClasses) {
  v1::Dataset dataset;
  v1::GetHistogramResponse histogram;
  EXPECT_EQ(FirstIsovalue(histogram, dataset), 0);
  dataset.mutable_value_range()->set_min(10);
  dataset.mutable_value_range()->set_max(30);
  EXPECT_EQ(FirstIsovalue(histogram, dataset), 20);
  v1::IsovalueSuggestion* suggestion = histogram.add_suggestions();
  suggestion->set_method(v1::IsovalueSuggestion::METHOD_ONE_PERCENT);
  suggestion->set_isovalue(25);
  EXPECT_EQ(FirstIsovalue(histogram, dataset), 25);
  suggestion = histogram.add_suggestions();
  suggestion->set_method(v1::IsovalueSuggestion::METHOD_BETWEEN_CLASSES);
  suggestion->set_isovalue(12);
  EXPECT_EQ(FirstIsovalue(histogram, dataset), 12);
}

TEST(ViewCommandTest, TheFirstLevelHasFewDigits) {
  v1::Dataset dataset;
  dataset.mutable_value_range()->set_min(0);
  dataset.mutable_value_range()->set_max(19.166);
  EXPECT_EQ(FirstIsovalue({}, dataset), 9.58);
  v1::GetHistogramResponse histogram;
  histogram.add_bins()->set_min(0);
  histogram.mutable_bins(0)->set_max(255);
  v1::IsovalueSuggestion* const suggestion = histogram.add_suggestions();
  suggestion->set_method(v1::IsovalueSuggestion::METHOD_BETWEEN_CLASSES);
  suggestion->set_isovalue(59.470588235294116);
  EXPECT_EQ(FirstIsovalue(histogram, dataset), 59.5);
}

TEST(ViewCommandTest, TheMiddleOfAWideRangeIsFinite) {
  v1::Dataset dataset;
  dataset.mutable_value_range()->set_min(-std::numeric_limits<double>::max());
  dataset.mutable_value_range()->set_max(std::numeric_limits<double>::max());
  EXPECT_EQ(FirstIsovalue({}, dataset), 0);
}

TEST(ViewCommandTest, TheAddressHasDatasetAndIsovalue) {
  EXPECT_EQ(ViewAddress("http://h:1/", "a b&c", 60.25, {}),
            "http://h:1/?dataset=a%20b%26c&isovalue=60.25");
  EXPECT_EQ(ViewAddress("http://h:1/?token=x", "a", -1e-7, {}),
            "http://h:1/?token=x&dataset=a&isovalue=-1e-07");
}

TEST(ViewCommandTest, TheAddressHasTheLabelsWithWhatIsGivenOfTheirColours) {
  const client::LabelSurface left{.values = {3}, .color = {.red = 1}};
  const client::LabelSurface both{.values = {-2, 7.5}, .color = {.red = 1}};
  std::vector<client::LabelSurface> all;
  for (const double value : {-2.0, 1.0, 2.0, 3.0, 4.0, 7.0, 8.0, 9.5}) {
    all.push_back({.values = {value}});
  }
  EXPECT_EQ(ViewAddress("http://h:1/", "a", std::nullopt,
                        {.wants_all = true, .smooths = true, .surfaces = all}),
            "http://h:1/?dataset=a&labels=-2,1-4,7,8,9.5&smooth-labels=1")
      << "short for many";
  const frame::Color color{.red = 0.5, .green = 0.25, .blue = 1};
  EXPECT_EQ(ViewAddress("http://h:1/", "a", 60,
                        {.sets = {{.set = "left", .opacity = 0.5F},
                                  {.set = "both", .color = color, .opacity = 0.25F},
                                  {.set = "left", .color = color}},
                         .surfaces = {left, both, left}}),
            "http://h:1/?dataset=a&isovalue=60&label=3::0.5&label=-2,7.5:0.5,0.25,1:0.25"
            "&label=3:0.5,0.25,1");
}

TEST(ViewCommandTest, WrongUsageIsNamed) {
  const struct {
    std::vector<std::string> arguments;
    std::string said;
  } cases[] = {
      {{"view"}, "give a volume"},
      {{"view", "a", "--server", "h:1"}, "--server"},
      {{"view", "a", "b", "--server", "h:1"}, "--server"},
      {{"view", "a", ""}, "empty"},
      {{"view", "a", "b", "--terminal"}, "--terminal shows one input, not 2"},
      {{"view", "a", "--isovalue", "x"}, "--isovalue"},
      {{"view", "a", "--listen", "8080"}, "--listen"},
      {{"view", "a", "--published", "8080"}, "--published"},
      {{"view", "a", "--isovale", "1"}, "--isovalue"},
      {{"view", "a", "--labels", "3,7"}, "--label 3,7"},
      {{"view", "a", "--labels", "all", "--label", "3"}, "leave --label out"},
      {{"view", "a", "--terminal", "--no-open"}, "--terminal can't be used with --no-open"},
      {{"view", "a", "--terminal", "--smooth-labels"}, "give --label SET or --labels all"},
      {{"view", "a", "--terminal", "--gateway-token-file", "t"}, "--gateway-token-file"},
      {{"view", "a", "--terminal", "--allow-origin", "https://hub.org"}, "--allow-origin"},
      {{"view", "a", "--allow-origin", "https://hub.org/lab"}, "is not an origin"},
      {{"view", "a", "--smooth-labels"}, "give --label SET or --labels all"},
  };
  for (const auto& c : cases) {
    std::ostringstream out;
    std::ostringstream err;
    Interrupt interrupt;
    EXPECT_EQ(RunProgram(IsoscopeProgram(), c.arguments,
                         {.out = &out, .err = &err, .interrupt = &interrupt}),
              kExitWrongUsage);
    EXPECT_THAT(err.str(), HasSubstr(c.said));
    EXPECT_EQ(out.str(), "");
  }
}

}  // namespace
}  // namespace isoscope::cli
