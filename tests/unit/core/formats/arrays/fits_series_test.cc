#include "core/formats/arrays/fits_series.h"

#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/open_volume.h"
#include "core/source/volume_source.h"
#include "tests/support/folder_test.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/arrays/fits_bytes.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::BytesOf;
using ::isoscope::testing::FitsCubeCards;
using ::isoscope::testing::FitsPartBytes;
using ::isoscope::testing::Gzip;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::Swapped;
using ::isoscope::testing::ValuesOf;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using volume::ScalarType;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

template <typename T>
std::vector<T> FitsRamp() {
  std::vector<T> values;
  for (int i = 0; i < 24; ++i) {
    values.push_back(static_cast<T>(3 * i + 1));
  }
  return values;
}

class FitsSeriesTest : public testing::FolderTest {
 protected:
  std::string WriteCube(const std::vector<std::string>& more, int bits = 8) {
    return Write("a.fits", FitsPartBytes(FitsCubeCards(bits, more), std::string(192, 'a')));
  }
  absl::Status Error(const std::vector<std::string>& more, int bits = 8) {
    return OpenVolumeFile(WriteCube(more, bits)).status();
  }
};

TEST_F(FitsSeriesTest, EveryTypePlainPackedAndInAnExtension) {
  struct Case {
    int bits;
    ScalarType type;
    std::string stored;  // little-endian
    std::string samples;
  };
  const std::string empty =
      FitsPartBytes({"SIMPLE  = T", "BITPIX  = 8", "NAXIS   = 0", "EXTEND  = T"}, "");
  for (const Case& c : std::vector<Case>{
           {8, ScalarType::kUint8, BytesOf(FitsRamp<std::uint8_t>()),
            BytesOf(FitsRamp<std::uint8_t>())},
           {16, ScalarType::kInt16, BytesOf(FitsRamp<std::int16_t>()),
            BytesOf(FitsRamp<std::int16_t>())},
           {32, ScalarType::kInt32, BytesOf(FitsRamp<std::int32_t>()),
            BytesOf(FitsRamp<std::int32_t>())},
           {64, ScalarType::kFloat64, BytesOf(FitsRamp<std::int64_t>()),
            BytesOf(FitsRamp<double>())},
           {-32, ScalarType::kFloat32, BytesOf(FitsRamp<float>()), BytesOf(FitsRamp<float>())},
           {-64, ScalarType::kFloat64, BytesOf(FitsRamp<double>()), BytesOf(FitsRamp<double>())}}) {
    const std::string stored = Swapped(c.stored, static_cast<std::size_t>(std::abs(c.bits) / 8));
    const std::string plain = FitsPartBytes(FitsCubeCards(c.bits), stored);
    const std::string extended =
        empty +
        FitsPartBytes(FitsCubeCards(c.bits, {"PCOUNT  = 0", "GCOUNT  = 1"}, "XTENSION= 'IMAGE   '"),
                      stored);
    for (const std::string& path :
         {Write("a.fits", plain), Write("a.fits.gz", Gzip(plain)), Write("noname", plain),
          Write("e.fits", extended), Write("e.fit.gz", Gzip(extended))}) {
      SCOPED_TRACE(absl::StrCat(path, " ", c.bits));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenVolumeFile(path));
      EXPECT_EQ(volume->info().type, c.type);
      EXPECT_EQ(volume->info().geometry.sample_dims, (math::Index3{4, 3, 2}));
      EXPECT_EQ(volume->info().note, "");
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string samples, ReadAll(*volume, 1));
      EXPECT_EQ(samples, c.samples);
    }
  }
}

TEST_F(FitsSeriesTest, ScaledAndBlankSamples) {
  const std::string stored = Swapped(BytesOf(FitsRamp<std::int16_t>()), 2);
  const auto read = [&](const std::vector<std::string>& more) {
    const std::string path = Write("a.fits", FitsPartBytes(FitsCubeCards(16, more), stored));
    const auto volume = OpenVolumeFile(path);
    EXPECT_TRUE(volume.ok()) << volume.status();
    EXPECT_EQ((*volume)->info().type, ScalarType::kFloat32);
    const auto samples = ReadAll(**volume, 1);
    EXPECT_TRUE(samples.ok());
    return ValuesOf<float>(*samples);
  };
  const std::vector<float> scaled = read({"BSCALE  = 0.5", "BZERO   = 32768"});
  const std::vector<float> blank = read({"BLANK   = 7"});
  const std::vector<float> both = read({"BSCALE  = 0.5", "BZERO   = 10", "BLANK   = 7"});
  for (int i = 0; i < 24; ++i) {
    const auto at = static_cast<std::size_t>(i);
    const float value = static_cast<float>(3 * i + 1);
    EXPECT_EQ(scaled[at], 0.5F * value + 32768);
    if (i == 2) {
      EXPECT_TRUE(std::isnan(blank[at]));
      EXPECT_TRUE(std::isnan(both[at]));
    } else {
      EXPECT_EQ(blank[at], value);
      EXPECT_EQ(both[at], 0.5F * value + 10);
    }
  }
  EXPECT_THAT(Error({"BSCALE  = 0"}), StatusIs(kInvalid, HasSubstr("BSCALE not 0")));
  EXPECT_THAT(Error({"BZERO   = 9223372036854775808"}, 64),
              StatusIs(kInvalid, HasSubstr("64-bit integers with BSCALE")));
  EXPECT_THAT(Error({"BLANK   = 0"}, 64),
              StatusIs(kInvalid, HasSubstr("64-bit integers with BSCALE")));
}

TEST_F(FitsSeriesTest, LinearCoordinatesOfOneUnitAreTheGrid) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto series,
      OpenVolumeSeries(
          WriteCube({"CTYPE1  = 'X'", "CTYPE2  = 'Y'", "CTYPE3  = 'Z'", "CUNIT1  = 'kpc'",
                     "CUNIT2  = 'kpc'", "CUNIT3  = 'kpc'", "CDELT1  = 0.5", "CDELT2  = -2",
                     "CDELT3  = 4", "CRPIX1  = 2", "CRPIX2  = 1", "CRPIX3  = 0", "CRVAL1  = 10",
                     "CRVAL2  = 20", "CRVAL3  = 30", "BUNIT   = 'Jy/beam '"})));
  EXPECT_EQ(series->info().length_unit, "kpc");
  EXPECT_EQ(series->info().field(0).unit, "Jy/beam");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(0, 0, 0));
  const math::Mat4d world = volume->info().geometry.world_from_index();
  EXPECT_EQ(math::TransformPoint(world, {0, 0, 0}), (math::Vec3d{9.5, 20, 34}));
  EXPECT_EQ(math::TransformPoint(world, {1, 1, 1}), (math::Vec3d{10, 18, 38}));
  // CD, and an axis of one sample between the others.
  const std::string path =
      Write("cd.fits", FitsPartBytes({"SIMPLE  = T", "BITPIX  = 8", "NAXIS   = 4", "NAXIS1  = 4",
                                      "NAXIS2  = 1", "NAXIS3  = 3", "NAXIS4  = 2", "CD1_3   = 2",
                                      "CD3_1   = 3", "CD4_4   = 5", "CD2_2   = 7"},
                                     std::string(24, 'a')));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto turned, OpenVolumeFile(path));
  EXPECT_EQ(math::TransformPoint(turned->info().geometry.world_from_index(), {1, 1, 1}),
            (math::Vec3d{2, 3, 5}));
}

TEST_F(FitsSeriesTest, CoordinatesOfTheSkyAreNoLengths) {
  for (const std::vector<std::string>& cards : std::vector<std::vector<std::string>>{
           {"CTYPE1  = 'RA---TAN'", "CTYPE2  = 'DEC--TAN'", "CTYPE3  = 'VELO-LSR'",
            "CDELT1  = -0.001", "CDELT2  = 0.001", "CDELT3  = 500", "CRVAL3  = 1E9"},
           {"CUNIT1  = 'm'", "CUNIT2  = 'm'", "CUNIT3  = 's'", "CDELT1  = 2"},
           {"CTYPE3  = 'FREQ'", "CDELT1  = 2"},
           {"CDELT1  = 2", "CROTA2  = 30"}}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(WriteCube(cards)));
    EXPECT_EQ(series->info().length_unit, "");
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(0, 0, 0));
    EXPECT_EQ(volume->info().geometry.spacing, (math::Vec3d{1, 1, 1}));
    EXPECT_EQ(volume->info().geometry.origin, (math::Vec3d{0, 0, 0}));
    EXPECT_THAT(volume->info().note, HasSubstr("samples are 1 apart"));
  }
  EXPECT_THAT(Error({"CDELT1  = 0"}), StatusIs(kInvalid, HasSubstr("--spacing")));
  EXPECT_THAT(Error({"CDELT1  = 'x'"}), StatusIs(kInvalid, HasSubstr("CDELT1 is \"x\"")));
  EXPECT_THAT(Error({"CD1_1   = 1", "PC1_1   = 1"}), StatusIs(kInvalid, HasSubstr("one of them")));
}

TEST_F(FitsSeriesTest, PartsAreFieldsByNameOrNumber) {
  const auto extension = [](const std::string& name, const std::string& cube, char value) {
    return FitsPartBytes(
        {"XTENSION= 'IMAGE   '", "BITPIX  = 8", "NAXIS   = 3", absl::StrCat("NAXIS1  = ", cube),
         "NAXIS2  = 3", "NAXIS3  = 2", absl::StrCat("EXTNAME = '", name, "'")},
        std::string(48, value).substr(0, cube == "4" ? 24 : 30));
  };
  const std::string path =
      Write("run.fits", FitsPartBytes(FitsCubeCards(8), std::string(24, 'p')) +
                            extension("SCI", "4", 's') + extension("ERR", "4", 'e') +
                            extension("SCI", "4", 't') + extension("BIG", "5", 'b'));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path));
  std::vector<std::string> names;
  for (const SourceField& field : series->info().fields) {
    names.push_back(field.name);
  }
  EXPECT_THAT(names, ElementsAre("run", "SCI", "ERR", "3"));
  EXPECT_THAT(series->info().fields_elsewhere, ElementsAre("BIG"));
  for (const auto& [part, value] : std::vector<std::pair<std::string, char>>{
           {"0", 'p'}, {"SCI", 's'}, {"sci", 's'}, {"err", 'e'}, {"3", 't'}, {"BIG", 'b'}}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenVolumeFile(path + ":" + part));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string samples, ReadAll(*volume, 1));
    EXPECT_EQ(samples, std::string(samples.size(), value)) << part;
  }
  EXPECT_THAT(OpenVolumeSeries(path + ":7"),
              StatusIs(absl::StatusCode::kNotFound,
                       AllOf(HasSubstr("no image \"7\""), HasSubstr("0, SCI, ERR, SCI, BIG"))));
}

TEST_F(FitsSeriesTest, WhatIsNoVolumeIsRefusedWithWhatToDo) {
  const auto error = [&](const std::vector<std::string>& cards) {
    return OpenVolumeSeries(Write("bad.fits", FitsPartBytes(cards, std::string(2880, 'a'))))
        .status();
  };
  EXPECT_THAT(error({"SIMPLE  = T", "BITPIX  = 8", "NAXIS   = 2", "NAXIS1  = 4", "NAXIS2  = 3"}),
              StatusIs(kInvalid, HasSubstr("axes of 4 x 3 samples")));
  EXPECT_THAT(error({"SIMPLE  = T", "BITPIX  = 8", "NAXIS   = 4", "NAXIS1  = 4", "NAXIS2  = 3",
                     "NAXIS3  = 2", "NAXIS4  = 2"}),
              StatusIs(kInvalid, HasSubstr("hdu.data[0]")));
  EXPECT_THAT(error({"SIMPLE  = T", "BITPIX  = 8", "NAXIS   = 0"}), StatusIs(kInvalid));
  const std::string packed =
      FitsPartBytes({"SIMPLE  = T", "BITPIX  = 8", "NAXIS   = 0"}, "") +
      FitsPartBytes({"XTENSION= 'BINTABLE'", "BITPIX  = 8", "NAXIS   = 2", "NAXIS1  = 8",
                     "NAXIS2  = 3", "PCOUNT  = 10", "GCOUNT  = 1", "ZIMAGE  = T"},
                    std::string(34, 't'));
  EXPECT_THAT(OpenVolumeSeries(Write("a.fits.fz", packed)),
              StatusIs(kInvalid, HasSubstr("funpack")));
  const std::string whole = FitsPartBytes(FitsCubeCards(8), std::string(24, 'a'));
  EXPECT_THAT(OpenVolumeFile(Write("cut.fits", whole.substr(0, 2880 + 23))),
              StatusIs(kInvalid, HasSubstr("the file has 2903")));
  ISOSCOPE_EXPECT_OK(OpenVolumeFile(Write("short.fits", whole.substr(0, 2880 + 24))).status());
}

}  // namespace
}  // namespace isoscope::source
