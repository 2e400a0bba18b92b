#include "wire/series_convert.h"

#include <limits>
#include <optional>

#include "gtest/gtest.h"

namespace isoscope::wire {
namespace {

// A scalar and a vector at two steps; the vector lacks the second one.
store::SeriesManifest Flow() {
  store::SeriesManifest manifest;
  manifest.dataset_id = "0123456789abcdef0123456789abcdef";
  manifest.name = "flow";
  manifest.geometry.sample_dims = {9, 9, 9};
  manifest.length_unit = "m";
  manifest.block_cells = {4, 4, 4};
  manifest.shard_count = 2;
  manifest.fields = {
      {.name = "p",
       .long_name = "pressure",
       .unit = "Pa",
       .components = {{.name = "", .scalar_type = volume::ScalarType::kFloat32}}},
      {.name = "u",
       .long_name = "",
       .unit = "m/s",
       .components = {{.name = "x", .scalar_type = volume::ScalarType::kInt16},
                      {.name = "magnitude", .scalar_type = volume::ScalarType::kFloat32}}}};
  manifest.times = {0.5, 2};
  manifest.time_unit = "s";
  const auto volume = [](int field, int component, int step, double min, double max,
                         std::optional<double> bound) {
    return store::ScalarVolume{.key = {field, component, step},
                               .dataset_id = "ffffffffffffffffffffffffffffffff",
                               .manifest_crc32c = 7,
                               .value_range = {min, max},
                               .max_gradient_magnitude = bound};
  };
  manifest.volumes = {volume(0, 0, 0, -3, 5, 2), volume(1, 0, 0, 1, -1, 1),
                      volume(1, 1, 0, 0, 4, std::nullopt), volume(0, 0, 1, -1, 9, 3)};
  return manifest;
}

TEST(SeriesConvertTest, RangesAndBoundsOfAFieldAreThoseOfAllSteps) {
  const isoscope::v1::Dataset dataset = ToProto(Flow());
  ASSERT_EQ(dataset.fields_size(), 2);
  const isoscope::v1::FieldComponent& pressure = dataset.fields(0).components(0);
  EXPECT_EQ(pressure.value_range().min(), -3);
  EXPECT_EQ(pressure.value_range().max(), 9);
  EXPECT_EQ(pressure.max_gradient_magnitude(), 3);
  // All NaN, and a volume whose bound nobody knows.
  EXPECT_FALSE(dataset.fields(1).components(0).has_value_range());
  EXPECT_FALSE(dataset.fields(1).components(1).has_max_gradient_magnitude());
}

TEST(SeriesConvertTest, TheFiniteRangeOfAFieldIsThatOfAllStepsIfAllAreKnown) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  store::SeriesManifest flow = Flow();
  EXPECT_FALSE(ToProto(flow).fields(0).components(0).has_finite_range()) << "as all samples";
  // Step 0 has finite samples in [-3, 5] only.
  flow.volumes[3].value_range = {-1, kInfinity};
  EXPECT_FALSE(ToProto(flow).fields(0).components(0).has_finite_range()) << "not known";
  flow.volumes[3].finite_range = volume::ScalarSpan{-1, 7};
  const isoscope::v1::Dataset dataset = ToProto(flow);
  const isoscope::v1::FieldComponent& pressure = dataset.fields(0).components(0);
  EXPECT_EQ(pressure.value_range().max(), kInfinity);
  EXPECT_EQ(pressure.finite_range().min(), -3);
  EXPECT_EQ(pressure.finite_range().max(), 7);
  EXPECT_EQ(dataset.finite_range().max(), 7) << "the first field is the default";
  EXPECT_FALSE(dataset.fields(1).components(1).has_finite_range());
  // A step without a finite sample adds none.
  flow.volumes[3].finite_range = volume::ScalarSpan();
  EXPECT_EQ(ToProto(flow).finite_range().max(), 5);
  flow.volumes.erase(flow.volumes.begin());
  EXPECT_FALSE(ToProto(flow).has_finite_range());
}

TEST(SeriesConvertTest, AClientThatKnowsNoFieldsSeesTheFirstOne) {
  const isoscope::v1::Dataset dataset = ToProto(Flow());
  EXPECT_EQ(dataset.name(), "flow");
  EXPECT_EQ(dataset.sample_type(), isoscope::v1::SAMPLE_TYPE_FLOAT32);
  EXPECT_EQ(dataset.value_range().max(), 9);
  EXPECT_EQ(dataset.max_gradient_magnitude(), 3);
  EXPECT_EQ(dataset.block_count(), 8);
  EXPECT_EQ(dataset.shard_count(), 2);
}

TEST(SeriesConvertTest, NamesUnitsAndTimesGoThrough) {
  const isoscope::v1::Dataset dataset = ToProto(Flow());
  EXPECT_EQ(dataset.time_unit(), "s");
  EXPECT_EQ(dataset.length_unit(), "m");
  ASSERT_EQ(dataset.time_steps_size(), 2);
  EXPECT_EQ(dataset.time_steps(1).value(), 2);
  EXPECT_EQ(dataset.time_steps(1).number(), 1);
  EXPECT_EQ(dataset.fields(0).long_name(), "pressure");
  EXPECT_EQ(dataset.fields(0).unit(), "Pa");
  EXPECT_EQ(dataset.fields(1).components(1).name(), "magnitude");
  EXPECT_EQ(dataset.fields(1).components(0).sample_type(), isoscope::v1::SAMPLE_TYPE_INT16);
}

TEST(SeriesConvertTest, AVolumeKeepsKeyAndDigest) {
  for (const store::ScalarVolume& volume : Flow().volumes) {
    const isoscope::internal::v1::VolumeDescription proto = ToProto(volume);
    EXPECT_EQ(KeyOf(proto), volume.key);
    EXPECT_EQ(proto.dataset_id(), volume.dataset_id);
    EXPECT_EQ(proto.manifest_crc32c(), volume.manifest_crc32c);
    EXPECT_EQ(proto.has_value_range(), volume.value_range.min <= volume.value_range.max);
    EXPECT_EQ(proto.has_max_gradient_magnitude(), volume.max_gradient_magnitude.has_value());
    EXPECT_FALSE(proto.has_finite_range());
  }
  store::ScalarVolume infinite = Flow().volumes.front();
  infinite.finite_range = volume::ScalarSpan{-1, 7};
  EXPECT_EQ(ToProto(infinite).finite_range().min(), -1);
  EXPECT_EQ(ToProto(infinite).finite_range().max(), 7);
  infinite.finite_range = volume::ScalarSpan();
  EXPECT_FALSE(ToProto(infinite).has_finite_range()) << "no sample is finite";
}

}  // namespace
}  // namespace isoscope::wire
