#include "client-cli/output/histogram_plot.h"

#include <algorithm>
#include <string>
#include <vector>

#include "absl/strings/str_split.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

namespace isoscope::cli {
namespace {

namespace v1 = isoscope::v1;
using ::testing::HasSubstr;
using ::testing::Not;

v1::GetHistogramResponse Example(int bin_count = 256) {
  v1::GetHistogramResponse histogram;
  histogram.set_has_sample_counts(true);
  histogram.set_nan_count(1234);
  for (int i = 0; i < bin_count; ++i) {
    v1::HistogramBin* bin = histogram.add_bins();
    bin->set_min(i);
    bin->set_max(i + 1);
    bin->set_sample_count(i == 0 ? 1'000'000 : (i * 37) % 1000);
    bin->set_active_block_count(i);
    bin->set_active_block_bytes(1000 * i);
    bin->set_estimated_triangle_count(179 * i);
  }
  v1::IsovalueSuggestion* suggestion = histogram.add_suggestions();
  suggestion->set_method(v1::IsovalueSuggestion::METHOD_BETWEEN_CLASSES);
  suggestion->set_isovalue(59.5);
  suggestion->set_inside_fraction(0.25);
  suggestion = histogram.add_suggestions();
  suggestion->set_method(v1::IsovalueSuggestion::METHOD_ONE_PERCENT);
  suggestion->set_isovalue(200.5);
  suggestion->set_inside_fraction(0.0099);
  return histogram;
}

// Characters, not bytes.
std::size_t WidthOf(const std::string& line) {
  return static_cast<std::size_t>(
      std::count_if(line.begin(), line.end(), [](char c) { return (c & 0xc0) != 0x80; }));
}

TEST(HistogramPlotTest, NoLineIsLongerThanTheTerminal) {
  for (const int width : {1, 40, 60, 80, 133, 400}) {
    for (const int bins : {1, 2, 79, 256, 4096}) {
      for (const bool is_logarithmic : {false, true}) {
        const std::string text =
            DrawHistogram(Example(bins), {.width = width, .is_logarithmic = is_logarithmic});
        for (const std::string& line : std::vector<std::string>(absl::StrSplit(text, '\n'))) {
          EXPECT_LE(WidthOf(line), static_cast<std::size_t>(std::max(width, 72)))
              << width << ": " << line;
        }
      }
    }
  }
}

TEST(HistogramPlotTest, TheTextSaysRangeSuggestionsAndWhatIsApart) {
  const std::string text = DrawHistogram(Example(), {});
  EXPECT_THAT(text, HasSubstr("1.0M |█"));
  EXPECT_THAT(text, HasSubstr("--isovalue 59.5"));
  EXPECT_THAT(text, HasSubstr("between two classes (25 % inside)"));
  EXPECT_THAT(text, HasSubstr("--isovalue 200.5"));
  EXPECT_THAT(text, HasSubstr("1,234 samples of NaN"));
  EXPECT_THAT(text, HasSubstr("256"));
  EXPECT_THAT(text, HasSubstr("active blocks"));
}

TEST(HistogramPlotTest, SuggestionsHaveTheDigitsThatTheRangeAsksFor) {
  v1::GetHistogramResponse histogram = Example();
  histogram.mutable_suggestions(0)->set_isovalue(59.470588235294116);
  EXPECT_THAT(DrawHistogram(histogram, {}), HasSubstr("--isovalue 59.5  "));
  EXPECT_EQ(HistogramToJson(histogram).at("suggestions").at(0).at("isovalue"), 59.470588235294116);
}

TEST(HistogramPlotTest, ALogarithmShowsWhatTheLargestBinHides) {
  const auto rows_of = [](const std::string& text) {
    return std::count(text.begin(), text.end(), '\x88');
  };
  EXPECT_GT(rows_of(DrawHistogram(Example(), {.is_logarithmic = true})),
            5 * rows_of(DrawHistogram(Example(), {})));
}

TEST(HistogramPlotTest, WithoutCountsItDrawsActiveBlocksAndSaysSo) {
  v1::GetHistogramResponse histogram = Example();
  histogram.set_has_sample_counts(false);
  histogram.clear_suggestions();
  const std::string text = DrawHistogram(histogram, {});
  EXPECT_THAT(text, HasSubstr("active blocks by isovalue"));
  EXPECT_THAT(text, HasSubstr("not counted"));
  EXPECT_THAT(text, Not(HasSubstr("suggested")));
}

TEST(HistogramPlotTest, LabelsAreSuggestedInPlaceOfIsovalues) {
  v1::GetHistogramResponse histogram = Example(3);
  histogram.add_suggested_labels(2);
  histogram.add_suggested_labels(3);
  const std::string text = DrawHistogram(histogram, {});
  EXPECT_THAT(text, HasSubstr("--labels all"));
  EXPECT_THAT(text, Not(HasSubstr("--isovalue")));
  const nlohmann::ordered_json json = HistogramToJson(histogram);
  EXPECT_EQ(json.at("suggested_labels"), nlohmann::ordered_json::array({2.0, 3.0}));
}

TEST(HistogramPlotTest, NoBinsAreASentence) {
  EXPECT_THAT(DrawHistogram({}, {}), HasSubstr("no sample is finite"));
}

TEST(HistogramPlotTest, TheJsonHasEveryNumber) {
  const nlohmann::ordered_json json = HistogramToJson(Example(3));
  EXPECT_EQ(json.at("has_sample_counts"), true);
  EXPECT_EQ(json.at("nan_count"), 1234);
  ASSERT_EQ(json.at("bins").size(), 3u);
  EXPECT_EQ(json.at("bins").at(2).at("min"), 2.0);
  EXPECT_EQ(json.at("bins").at(2).at("max"), 3.0);
  EXPECT_EQ(json.at("bins").at(2).at("sample_count"), 74);
  EXPECT_EQ(json.at("bins").at(2).at("active_block_count"), 2);
  EXPECT_EQ(json.at("bins").at(2).at("active_block_bytes"), 2000);
  EXPECT_EQ(json.at("bins").at(2).at("estimated_triangle_count"), 358);
  EXPECT_EQ(json.at("suggestions").at(0).at("method"), "between_classes");
  EXPECT_EQ(json.at("suggestions").at(1).at("method"), "one_percent");
  EXPECT_EQ(json.at("suggestions").at(1).at("isovalue"), 200.5);
}

}  // namespace
}  // namespace isoscope::cli
