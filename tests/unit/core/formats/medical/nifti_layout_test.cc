#include "core/formats/medical/nifti_layout.h"

#include <cmath>
#include <cstring>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/open_volume.h"
#include "core/source/volume_series.h"
#include "core/source/volume_source.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::NiftiHeaderBytes;
using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

class NiftiLayoutTest : public ::testing::Test {
 protected:
  absl::StatusOr<NiftiLayout> Read(const std::string& bytes) {
    testing::WriteFile(dir_.Sub("a.nii"), bytes);
    return ReadNiftiLayout(dir_.Sub("a.nii"));
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
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(NiftiLayout layout, Read(With(four, 92, 2.5F)));
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
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const NiftiLayout layout, Read(With(four, 92, interval)));
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
    EXPECT_EQ(volume->geometry().sample_dims, (math::Index3{4, 3, 2}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, testing::ReadAll(*volume, 2));
    EXPECT_TRUE(read == samples);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(dir_.Sub(name)));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto first, series->Open(0, 0, 0));
    EXPECT_EQ(first->geometry(), volume->geometry());
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
