#include "core/formats/medical/nifti_layout.h"

#include <cmath>
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/medical/layout_formats.h"
#include "core/formats/open_volume.h"
#include "core/source/volume_series.h"
#include "core/source/volume_source.h"
#include "tests/support/medical_files.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::NiftiHeaderBytes;
using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

class NiftiLayoutTest : public ::testing::Test {
 protected:
  absl::StatusOr<FileLayout> Read(const std::string& bytes) {
    testing::WriteFile(dir_.Sub("a.nii"), bytes);
    return ReadNiftiHeaderLayout(dir_.Sub("a.nii"));
  }
  testing::TempDir dir_;
};

template <typename T>
std::string With(std::string bytes, std::size_t offset, T value) {
  std::memcpy(bytes.data() + offset, &value, sizeof(value));
  return bytes;
}

TEST_F(NiftiLayoutTest, FourthAxisIsTimeAndTheFifthComponents) {
  const std::string four = NiftiHeaderBytes({.dims = {4, 3, 2}, .dim_count = 4, .dim4 = 7});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(FileLayout layout, Read(With(four, 92, 2.5F)));
  EXPECT_EQ(layout.steps, 7);
  EXPECT_EQ(layout.components, 1);
  EXPECT_EQ(layout.interval, 2.5);
  EXPECT_EQ(layout.time_unit, "s");
  EXPECT_EQ(layout.length_unit, "mm");
  const std::string five = With(With(four, 40, std::int16_t{5}), 50, std::int16_t{3});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(layout, Read(With(five, 123, std::uint8_t{16})));
  EXPECT_EQ(layout.components, 3);
  EXPECT_EQ(layout.time_unit, "ms");
  EXPECT_EQ(layout.length_unit, "");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(layout, Read(NiftiHeaderBytes({.dims = {4, 3, 2}, .dim4 = 9})));
  EXPECT_EQ(layout.steps, 1) << "behind the last axis";
}

TEST_F(NiftiLayoutTest, IntervalThatIsNoneIsOneWithoutAUnit) {
  const std::string four = NiftiHeaderBytes({.dims = {4, 3, 2}, .dim_count = 4, .dim4 = 7});
  for (const float interval : {0.0F, -1.0F, std::nanf("")}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FileLayout layout, Read(With(four, 92, interval)));
    EXPECT_EQ(layout.interval, 1);
    EXPECT_EQ(layout.time_unit, "");
  }
}

TEST_F(NiftiLayoutTest, SizesThatAreNoneAreRefused) {
  constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
  const std::string four = NiftiHeaderBytes({.dims = {4, 3, 2}, .dim_count = 4, .dim4 = 7});
  EXPECT_THAT(Read(With(four, 40, std::int16_t{8})), StatusIs(kInvalid, HasSubstr("8 axes")));
  EXPECT_THAT(Read(With(four, 48, std::int16_t{0})),
              StatusIs(kInvalid, HasSubstr("a.nii: 4 x 3 x 2 x 0")));
  EXPECT_THAT(Read(With(With(four, 40, std::int16_t{6}), 52, std::int16_t{2})),
              StatusIs(kInvalid, HasSubstr("x 1 x 2 x 1 samples")));
}

// The time of the first step was taken as 0.
TEST_F(NiftiLayoutTest, TimesBeginAtTheOffsetOfTheHeader) {
  const std::string samples = std::string(7 * 48, '\1');
  const std::string four = NiftiHeaderBytes({.dims = {4, 3, 2}, .dim_count = 4, .dim4 = 7});
  const auto times = [&](const std::string& bytes) {
    testing::WriteFile(dir_.Sub("t.nii"), bytes + samples);
    const auto series = OpenVolumeSeries(dir_.Sub("t.nii"));
    EXPECT_TRUE(series.ok()) << series.status();
    return series.ok() ? (*series)->info().times : std::vector<double>();
  };
  EXPECT_THAT(times(With(With(four, 92, 2.0F), 136, 10.0F)),
              ElementsAre(10, 12, 14, 16, 18, 20, 22));
  EXPECT_THAT(times(With(With(four, 92, 2.0F), 136, -3.0F)), ElementsAre(-3, -1, 1, 3, 5, 7, 9));
  EXPECT_THAT(times(With(testing::Nifti2Bytes({.steps = 3}), 216, 10.0)),
              ElementsAre(10, 10.5, 11));
  // Without an interval steps have numbers.
  EXPECT_THAT(times(With(With(four, 92, 0.0F), 136, 10.0F)), ElementsAre(0, 1, 2, 3, 4, 5, 6));
  constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
  for (const float bad : {std::nanf(""), INFINITY}) {
    EXPECT_THAT(Read(With(four, 136, bad)),
                StatusIs(kInvalid, AllOf(HasSubstr("a.nii: "), HasSubstr("toffset"))));
    EXPECT_TRUE(Read(With(NiftiHeaderBytes({.dims = {4, 3, 2}}), 136, bad)).ok()) << "one step";
  }
  // 1e10 + 1 is 1e10 as float, but not as double.
  EXPECT_EQ(times(With(four, 136, 1e10F)).size(), 7U);
  testing::WriteFile(dir_.Sub("t.nii"), With(With(four, 136, 1e30F), 92, 1.0F) + samples);
  EXPECT_THAT(OpenVolumeSeries(dir_.Sub("t.nii")),
              StatusIs(kInvalid, AllOf(HasSubstr("t.nii: 7 steps"), HasSubstr("1e+30"))));
}

// A vox_offset within the header read samples from the bytes that tell of extensions.
TEST_F(NiftiLayoutTest, SamplesOfASingleFileLieBehindTheHeader) {
  constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
  const std::string samples = testing::Noise({4, 3, 2}, volume::ScalarType::kInt16);
  const std::string first = NiftiHeaderBytes({.dims = {4, 3, 2}});
  const std::string second = testing::Nifti2Bytes({});
  const auto read = [&](const std::string& name, const std::string& bytes) {
    testing::WriteFile(dir_.Sub(name), bytes);
    const auto volume = OpenVolumeFile(dir_.Sub(name));
    return volume.ok() ? testing::ReadAll(**volume, 2)
                       : absl::StatusOr<std::string>(volume.status());
  };
  for (const float offset : {0.0F, 352.0F}) {
    EXPECT_EQ(read("a.nii", With(first, 108, offset) + samples).value(), samples) << offset;
  }
  EXPECT_EQ(read("a.nii", With(first, 108, 368.0F) + std::string(16, 'e') + samples).value(),
            samples);
  for (const float offset : {1.0F, 100.0F, 348.0F, 351.0F}) {
    EXPECT_THAT(read("a.nii", With(first, 108, offset) + samples),
                StatusIs(kInvalid, AllOf(HasSubstr("vox_offset"), HasSubstr("352"))))
        << offset;
  }
  for (const std::int64_t offset : {std::int64_t{0}, std::int64_t{544}}) {
    EXPECT_EQ(read("b.nii", With(second, 168, offset) + samples).value(), samples) << offset;
  }
  for (const std::int64_t offset : {std::int64_t{352}, std::int64_t{543}}) {
    EXPECT_THAT(read("b.nii", With(second, 168, offset) + samples),
                StatusIs(kInvalid, AllOf(HasSubstr("vox_offset"), HasSubstr("544"))))
        << offset;
  }
  // The samples of a pair begin anywhere in their own file.
  testing::WriteFile(dir_.Sub("p.img"), "skip!" + samples);
  const std::string pair = NiftiHeaderBytes({.dims = {4, 3, 2}, .is_pair = true});
  EXPECT_EQ(read("p.hdr", With(pair, 108, 5.0F)).value(), samples);
}

// Servers and browsers unpack or rename such files. Content decides, as in nibabel's and ITK's
// zlib.
TEST_F(NiftiLayoutTest, GzipStreamIsKnownByItsContentWhateverTheNameSays) {
  const std::string samples = testing::Noise({4, 3, 2}, volume::ScalarType::kInt16);
  const std::string plain = NiftiHeaderBytes({.dims = {4, 3, 2}}) + samples;
  for (const auto& [name, bytes] :
       {std::pair{"a.nii", plain}, std::pair{"a.nii.gz", testing::Gzip(plain)},
        std::pair{"b.nii", testing::Gzip(plain)}, std::pair{"b.nii.gz", plain}}) {
    SCOPED_TRACE(name);
    testing::WriteFile(dir_.Sub(name), bytes);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenVolumeFile(dir_.Sub(name)));
    EXPECT_EQ(volume->info().geometry.sample_dims, (math::Index3{4, 3, 2}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, testing::ReadAll(*volume, 2));
    EXPECT_TRUE(read == samples);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(dir_.Sub(name)));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto first, series->Open(0, 0, 0));
    EXPECT_EQ(first->info().geometry, volume->info().geometry);
  }
}

TEST_F(NiftiLayoutTest, SamplesBesideTheirHeaderAreAStreamIfNameAndContentSaySo) {
  testing::WriteFile(dir_.Sub("a.img.gz"), testing::Gzip("samples"));
  testing::WriteFile(dir_.Sub("plain.img.gz"), "samples");
  testing::WriteFile(dir_.Sub("odd.img"), "\x1f\x8b\x08 may be samples");
  const auto is_stream = [&](const std::string& name) {
    return IsNiftiStream(dir_.Sub("a.hdr"), dir_.Sub(name));
  };
  EXPECT_TRUE(is_stream("a.img.gz"));
  EXPECT_FALSE(is_stream("plain.img.gz"));
  EXPECT_FALSE(is_stream("odd.img"));
  EXPECT_FALSE(is_stream("none.img.gz"));
}

}  // namespace
}  // namespace isoscope::source
