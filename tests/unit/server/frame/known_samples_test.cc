#include "server/frame/known_samples.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace isoscope::server {
namespace {

using ::testing::HasSubstr;
using ProtoNote = isoscope::v1::SurfaceNote;
using volume::InsideRule;
using volume::ScalarType;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// A histogram of samples with these counts, as AskHistogram gives it.
volume::HistogramPart HistogramOf(ScalarType type, const std::map<double, std::int64_t>& counts) {
  volume::HistogramPart part;
  volume::ScalarSpan finite;
  for (const auto& [value, count] : counts) {
    part.value_range.min = std::min(part.value_range.min, value);
    part.value_range.max = std::max(part.value_range.max, value);
    if (std::isfinite(value)) {
      finite.min = std::min(finite.min, value);
      finite.max = std::max(finite.max, value);
    }
  }
  volume::SampleHistogram& samples = part.samples.emplace();
  samples.bins = volume::BinsOf(type, finite);
  samples.counts.resize(static_cast<std::size_t>(samples.bins.count));
  for (const auto& [value, count] : counts) {
    if (std::isfinite(value)) {
      samples.counts[static_cast<std::size_t>(samples.bins.IndexOf(value))] += count;
    }
  }
  return part;
}

KnownSamples Known(ScalarType type, const std::map<double, std::int64_t>& counts,
                   std::vector<volume::Label> labels = {}, const std::string& when = "") {
  return {type, HistogramOf(type, counts), std::move(labels), when};
}

TEST(KnownSamplesTest, AnIsovalueWithSamplesOnBothSidesIsNoMatter) {
  const KnownSamples known = Known(ScalarType::kInt16, {{-1, 5}, {255, 1}});
  for (const double isovalue : {-0.999, 0.0, 254.5, 255.0}) {
    EXPECT_FALSE(known.NoteOf(InsideRule::OfIsovalue(isovalue)).has_value()) << isovalue;
  }
}

TEST(KnownSamplesTest, AnIsovalueBeyondTheSamplesIsNamedWithTheirRange) {
  const KnownSamples known = Known(ScalarType::kInt16, {{-1, 5}, {255, 1}});
  for (const double isovalue : {-2.0, -1.0, 255.125, 1e30}) {
    const auto note = known.NoteOf(InsideRule::OfIsovalue(isovalue));
    ASSERT_TRUE(note.has_value()) << isovalue;
    EXPECT_EQ(note->first, ProtoNote::REASON_OUTSIDE_RANGE);
    EXPECT_THAT(note->second,
                HasSubstr("has no surface: the values of the volume are in [-1, 255], and it must "
                          "be above the smallest and at most the largest"));
  }
  EXPECT_THAT(known.NoteOf(InsideRule::OfIsovalue(255.125))->second,
              HasSubstr("isovalue 255.125 "));
  EXPECT_TRUE(Known(ScalarType::kUint8, {{3, 9}}).NoteOf(InsideRule::OfIsovalue(3)).has_value())
      << "a constant volume";
  EXPECT_THAT(Known(ScalarType::kUint8, {{3, 9}}, {}, " at step 7")
                  .NoteOf(InsideRule::OfIsovalue(4))
                  ->second,
              HasSubstr("the values of the volume at step 7 are in [3, 3]"));
}

TEST(KnownSamplesTest, AVolumeOfInfinityHasNoRange) {
  for (const double infinity : {kInfinity, -kInfinity}) {
    const auto note = Known(ScalarType::kFloat32, {{infinity, 9}}, {}, " at step 2")
                          .NoteOf(InsideRule::OfIsovalue(1));
    ASSERT_TRUE(note.has_value());
    EXPECT_EQ(note->first, ProtoNote::REASON_OUTSIDE_RANGE);
    EXPECT_EQ(note->second,
              "isovalue 1 has no surface: no sample of the volume at step 2 is finite");
  }
}

TEST(KnownSamplesTest, AVolumeOfNanHasNoSurfaceAtAll) {
  const KnownSamples known = Known(ScalarType::kFloat32, {});
  for (const InsideRule& rule : {InsideRule::OfIsovalue(0), InsideRule::OfLabels({1, 2})}) {
    const auto note = known.NoteOf(rule);
    ASSERT_TRUE(note.has_value());
    EXPECT_EQ(note->first, ProtoNote::REASON_NO_SAMPLES);
    EXPECT_THAT(note->second, HasSubstr("every sample of the volume is NaN"));
  }
}

// Symptom: a label that no sample has, but that lies in the range, drew nothing without a word.
TEST(KnownSamplesTest, ALabelThatNoSampleHasIsNamedWithThoseThatThereAre) {
  const KnownSamples known =
      Known(ScalarType::kUint8, {{0, 9}, {1, 2}, {2, 2}, {3, 2}, {7, 1}, {9, 1}}, {{5, "spleen"}});
  EXPECT_FALSE(known.NoteOf(InsideRule::OfLabels({7})).has_value());
  EXPECT_FALSE(known.NoteOf(InsideRule::OfLabels({0, 1, 2, 3, 7, 9})).has_value());
  for (const double absent : {4.0, 8.0, -1.0, 10.0, 300.0, 2.5}) {
    const auto note = known.NoteOf(InsideRule::OfLabels({absent}));
    ASSERT_TRUE(note.has_value()) << absent;
    EXPECT_EQ(note->first, ProtoNote::REASON_NO_LABEL);
    EXPECT_THAT(note->second, HasSubstr("no sample has it; the samples are 0 to 3, 7, 9"));
  }
  EXPECT_THAT(known.NoteOf(InsideRule::OfLabels({5}))->second,
              HasSubstr("label 5 (spleen) has no surface: no sample has it; "));
  EXPECT_THAT(known.NoteOf(InsideRule::OfLabels({5, 6}))->second,
              HasSubstr("labels 5 (spleen), 6 have no surface: no sample has one of them; "));
}

TEST(KnownSamplesTest, ASetWithSomeMissingLabelsNamesThese) {
  const KnownSamples known = Known(ScalarType::kInt32, {{0, 9}, {-4, 2}, {7, 1}});
  const auto note = known.NoteOf(InsideRule::OfLabels({-4, 3, 7, 8}));
  ASSERT_TRUE(note.has_value());
  EXPECT_EQ(note->first, ProtoNote::REASON_SOME_LABELS_MISSING);
  EXPECT_EQ(note->second, "no sample has labels 3, 8 of -4, 3, 7, 8; the samples are -4, 0, 7");
  EXPECT_THAT(known.NoteOf(InsideRule::OfLabels({7, 8}))->second,
              HasSubstr("no sample has label 8 of 7, 8; "));
}

TEST(KnownSamplesTest, LabelsOfFloatsAndOfManyValuesAreToldByTheirRange) {
  const KnownSamples floats = Known(ScalarType::kFloat32, {{0, 9}, {1, 2}, {4, 2}});
  EXPECT_FALSE(floats.NoteOf(InsideRule::OfLabels({4})).has_value());
  EXPECT_THAT(floats.NoteOf(InsideRule::OfLabels({2}))->second,
              HasSubstr("no sample has it; the values of the volume are in [0, 4]"));
  // No float32 is 0.1.
  EXPECT_TRUE(floats.NoteOf(InsideRule::OfLabels({0.1})).has_value());
  // Bins of several values can't tell that a label is there, but that it is not.
  const KnownSamples wide = Known(ScalarType::kUint16, {{0, 9}, {7, 3}, {65535, 1}});
  EXPECT_FALSE(wide.NoteOf(InsideRule::OfLabels({7})).has_value());
  EXPECT_FALSE(wide.NoteOf(InsideRule::OfLabels({8})).has_value()) << "in the bin of 7";
  EXPECT_THAT(wide.NoteOf(InsideRule::OfLabels({30000}))->second, HasSubstr("[0, 65535]"));
}

TEST(KnownSamplesTest, InfiniteSamplesAreNoLabelsAndHideNone) {
  const KnownSamples known =
      Known(ScalarType::kFloat64, {{-kInfinity, 1}, {0, 9}, {4, 2}, {kInfinity, 1}});
  EXPECT_FALSE(known.NoteOf(InsideRule::OfLabels({4})).has_value());
  const volume::HistogramBins bins = volume::BinsOf(ScalarType::kFloat64, {.min = 0, .max = 4});
  for (const double absent : {3.0, 5.0, -1e300, 1e300, bins.EdgeOf(bins.count)}) {
    EXPECT_TRUE(known.NoteOf(InsideRule::OfLabels({absent})).has_value()) << absent;
  }
  EXPECT_FALSE(known.NoteOf(InsideRule::OfIsovalue(1e300)).has_value());
}

TEST(KnownSamplesTest, WithoutCountsOnlyTheRangeDecides) {
  volume::HistogramPart part = HistogramOf(ScalarType::kUint8, {{0, 9}, {9, 1}});
  part.samples.reset();
  const KnownSamples known(ScalarType::kUint8, part, {}, "");
  EXPECT_FALSE(known.NoteOf(InsideRule::OfLabels({5})).has_value());
  EXPECT_THAT(known.NoteOf(InsideRule::OfLabels({10}))->second, HasSubstr("[0, 9]"));
}

TEST(KnownSamplesTest, LongListsAreCut) {
  std::map<double, std::int64_t> counts;
  std::vector<double> absent;
  for (int i = 0; i < 40; ++i) {
    counts[3 * i] = 1;
    absent.push_back(3 * i + 1);
  }
  const KnownSamples known = Known(ScalarType::kUint8, counts);
  const std::string text = known.NoteOf(InsideRule::OfLabels(absent))->second;
  EXPECT_THAT(text,
              HasSubstr("labels 1, 4, 7, 10, 13, 16, 19, 22, 25, 28, 31, 34 and 28 more have"));
  EXPECT_THAT(text, HasSubstr("the samples are 0, 3, 6, 9, 12, 15, 18, 21, 24, 27, 30, 33 and 28 "
                              "more"));
}

TEST(KnownSamplesTest, ASurfaceWithoutCellsIsToldFromOneWithoutSamples) {
  const KnownSamples known = Known(ScalarType::kFloat32, {{0, 9}, {10, 1}});
  const KnownSamples::Note gap = known.NoCellNoteOf(InsideRule::OfIsovalue(5));
  EXPECT_EQ(gap.first, ProtoNote::REASON_NO_CELL);
  EXPECT_EQ(gap.second,
            "isovalue 5 has no surface: the values of the volume are in [0, 10], but no cell has "
            "samples on both sides of it: missing ones (NaN) lie between them");
  EXPECT_THAT(known.NoCellNoteOf(InsideRule::OfLabels({0, 10})).second,
              HasSubstr("labels 0, 10 have no surface: no cell has a sample inside and one "
                        "outside; "));
}

// Means of a level may lack what its samples are too coarse for: no missing samples are to blame.
TEST(KnownSamplesTest, ASurfaceThatALevelLacksMayShowAtLevelZero) {
  const KnownSamples known = Known(ScalarType::kFloat32, {{0, 9}, {10, 1}});
  for (const InsideRule& rule : {InsideRule::OfIsovalue(5), InsideRule::OfLabels({10})}) {
    const KnownSamples::Note note = known.NoCellNoteOf(rule, /*level=*/2);
    EXPECT_EQ(note.first, ProtoNote::REASON_NO_CELL);
    EXPECT_THAT(note.second, HasSubstr("no cell of level 2"));
    EXPECT_THAT(note.second, HasSubstr("may show at level 0"));
  }
}

}  // namespace
}  // namespace isoscope::server
