#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/medical/layout_formats.h"
#include "core/formats/open_volume.h"
#include "tests/support/folder_test.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::BytesOf;
using ::isoscope::testing::Gzip;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::Swapped;
using ::testing::HasSubstr;
using volume::ScalarType;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr std::size_t kOffset = 400;

struct Mif {
  std::string dim = "4,3,2";
  std::string vox = "0.5,2,4";
  std::string layout = "+0,+1,+2";
  std::string type = "UInt8";
  std::string transform = "transform: 1,0,0,10\ntransform: 0,1,0,20\ntransform: 0,0,1,30\n";
  std::string more{};
  std::string file = "file: . 400\n";
};

std::string MifText(const Mif& mif) {
  return absl::StrCat("mrtrix image\ndim: ", mif.dim, "\nvox: ", mif.vox,
                      " # mm\nlayout: ", mif.layout, "\ndatatype: ", mif.type, "\n", mif.transform,
                      "command_history: x: y\n", mif.more, mif.file, "END\n");
}

std::string MifBytes(const Mif& mif, const std::string& samples) {
  std::string bytes = MifText(mif);
  bytes.resize(kOffset, '\0');
  return bytes + samples;
}

template <typename T>
std::vector<T> MifRamp(int count = 24) {
  std::vector<T> values;
  for (int i = 0; i < count; ++i) {
    values.push_back(static_cast<T>(3 * i - 20));
  }
  return values;
}

class MrtrixLayoutTest : public testing::FolderTest {
 protected:
  absl::Status Error(const Mif& mif) {
    const auto series = OpenVolumeSeries(Write("bad.mif", MifBytes(mif, std::string(192, 'a'))));
    return series.ok() ? (*series)->Open(0, 0, 0).status() : series.status();
  }
};

TEST_F(MrtrixLayoutTest, EveryTypeInBothByteOrdersPlainPackedAndBeside) {
  struct Case {
    std::string type;
    ScalarType read_as;
    std::size_t size;
    std::string stored;   // little-endian
    std::string samples;  // as they are read
  };
  const std::vector<Case> cases = {
      {"Int8", ScalarType::kInt8, 1, BytesOf(MifRamp<std::int8_t>()),
       BytesOf(MifRamp<std::int8_t>())},
      {"UInt8", ScalarType::kUint8, 1, BytesOf(MifRamp<std::uint8_t>()),
       BytesOf(MifRamp<std::uint8_t>())},
      {"Int16", ScalarType::kInt16, 2, BytesOf(MifRamp<std::int16_t>()),
       BytesOf(MifRamp<std::int16_t>())},
      {"UInt16", ScalarType::kUint16, 2, BytesOf(MifRamp<std::uint16_t>()),
       BytesOf(MifRamp<std::uint16_t>())},
      {"Int32", ScalarType::kInt32, 4, BytesOf(MifRamp<std::int32_t>()),
       BytesOf(MifRamp<std::int32_t>())},
      {"UInt32", ScalarType::kUint32, 4, BytesOf(MifRamp<std::uint32_t>()),
       BytesOf(MifRamp<std::uint32_t>())},
      {"Int64", ScalarType::kFloat64, 8, BytesOf(MifRamp<std::int64_t>()),
       BytesOf(MifRamp<double>())},
      {"UInt64", ScalarType::kFloat64, 8, BytesOf(std::vector<std::uint64_t>(24, 9)),
       BytesOf(std::vector<double>(24, 9))},
      {"Float16", ScalarType::kFloat32, 2, BytesOf(std::vector<std::uint16_t>(24, 0x3e00)),
       BytesOf(std::vector<float>(24, 1.5F))},
      {"Float32", ScalarType::kFloat32, 4, BytesOf(MifRamp<float>()), BytesOf(MifRamp<float>())},
      {"Float64", ScalarType::kFloat64, 8, BytesOf(MifRamp<double>()), BytesOf(MifRamp<double>())}};
  for (const Case& c : cases) {
    for (const bool is_big_endian : {false, true}) {
      const std::string stored = is_big_endian ? Swapped(c.stored, c.size) : c.stored;
      Mif mif{.type = absl::StrCat(c.type, c.size == 1 ? "" : is_big_endian ? "BE" : "LE")};
      const std::string bytes = MifBytes(mif, stored);
      Write("a.dat", stored);
      mif.file = "file: a.dat 0\n";
      Write("b1.dat", "head" + stored.substr(0, stored.size() / 2));
      Write("b2.dat", "head" + stored.substr(stored.size() / 2));
      Mif parts = mif;
      parts.file = "file: b1.dat 4\nfile: b2.dat 4\n";
      for (const std::string& path :
           {Write("a.mif", bytes), Write("a.mif.gz", Gzip(bytes)), Write("noname", bytes),
            Write("a.mih", MifText(mif)), Write("b.mih", MifText(parts))}) {
        SCOPED_TRACE(path + " " + mif.type);
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenVolumeFile(path));
        EXPECT_EQ(volume->info().type, c.read_as);
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string samples, ReadAll(*volume, 1));
        EXPECT_EQ(samples, c.samples);
      }
    }
  }
}

// Each order and sign of the axes, against the definition: the sample of logical indices (i, j, k)
// lies at transform * (vox * index), whichever way it is stored.
TEST_F(MrtrixLayoutTest, SamplesLieWhereMrtrixPutsThemInEveryLayout) {
  const std::int64_t dims[3] = {4, 3, 2};
  const double vox[3] = {0.5, 2, 4};
  const double rows[3][4] = {{0, -1, 0, 10}, {1, 0, 0, 20}, {0, 0, 1, 30}};
  for (const std::vector<int>& ranks : std::vector<std::vector<int>>{
           {0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}}) {
    for (int signs = 0; signs < 8; ++signs) {
      std::string layout;
      std::int64_t strides[3] = {1, 1, 1};
      for (std::size_t a = 0; a < 3; ++a) {
        absl::StrAppend(&layout, a == 0 ? "" : ",", (signs >> a & 1) != 0 ? "-" : "+", ranks[a]);
        for (std::size_t b = 0; b < 3; ++b) {
          strides[a] *= ranks[b] < ranks[a] ? dims[b] : 1;
        }
      }
      std::string samples(24, '\0');  // i + 10 j + 100 k
      for (std::int64_t n = 0; n < 24; ++n) {
        const std::int64_t index[3] = {n % 4, n / 4 % 3, n / 12};
        std::int64_t at = 0;
        for (std::size_t a = 0; a < 3; ++a) {
          at += strides[a] * ((signs >> a & 1) != 0 ? dims[a] - 1 - index[a] : index[a]);
        }
        samples[static_cast<std::size_t>(at)] =
            static_cast<char>(index[0] + 10 * index[1] + 100 * index[2]);
      }
      SCOPED_TRACE(layout);
      const Mif mif{.layout = layout,
                    .transform =
                        "transform: 0,-1,0,10\ntransform: 1,0,0,20\n"
                        "transform: 0,0,1,30\ntransform: 0,0,0,1\n"};
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume,
                                    OpenVolumeFile(Write("a.mif", MifBytes(mif, samples))));
      EXPECT_TRUE(volume->info().patient_frame.has_value());
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*volume, 1));
      const volume::GridGeometry& grid = volume->info().geometry;
      const math::Index3& size = grid.sample_dims;
      for (std::int64_t n = 0; n < 24; ++n) {
        const int value = static_cast<unsigned char>(read[static_cast<std::size_t>(n)]);
        const double index[3] = {static_cast<double>(value % 10),
                                 static_cast<double>(value / 10 % 10),
                                 static_cast<double>(value / 100)};
        double ras[3];
        for (std::size_t r = 0; r < 3; ++r) {
          ras[r] = rows[r][3];
          for (std::size_t a = 0; a < 3; ++a) {
            ras[r] += rows[r][a] * vox[a] * index[a];
          }
        }
        const math::Vec3d at = math::TransformPoint(
            grid.world_from_index(),
            {static_cast<double>(n % size.x), static_cast<double>(n / size.x % size.y),
             static_cast<double>(n / size.x / size.y)});
        EXPECT_LT(math::Length(at - math::Vec3d{-ras[0], -ras[1], ras[2]}), 1e-9);
      }
    }
  }
}

TEST_F(MrtrixLayoutTest, WithoutATransformTheCentreIsAtZero) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto volume,
      OpenVolumeFile(Write("a.mif", MifBytes({.transform = ""}, std::string(24, 'a')))));
  const math::Vec3d centre =
      math::TransformPoint(volume->info().geometry.world_from_index(), {1.5, 1, 0.5});
  EXPECT_LT(math::Length(centre), 1e-12);
  EXPECT_FALSE(volume->info().patient_frame.has_value());
}

TEST_F(MrtrixLayoutTest, AFourthAxisIsStepsFastestOrSlowest) {
  const auto values = MifRamp<std::uint8_t>(48);
  for (const bool is_fastest : {false, true}) {
    const Mif mif{.dim = "4,3,2,2,1",
                  .vox = "1,1,1,nan,nan",
                  .layout = is_fastest ? "+1,+2,+3,+0,+4" : "+0,+1,+2,+4,+3"};
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series,
                                  OpenVolumeSeries(Write("a.mif", MifBytes(mif, BytesOf(values)))));
    EXPECT_THAT(series->info().times, ::testing::ElementsAre(0, 1));
    for (int step = 0; step < 2; ++step) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(0, 0, step));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string samples, ReadAll(*volume, 1));
      for (std::size_t i = 0; i < 24; ++i) {
        const std::size_t at = is_fastest ? 2 * i + static_cast<std::size_t>(step)
                                          : i + 24 * static_cast<std::size_t>(step);
        EXPECT_EQ(static_cast<unsigned char>(samples[i]), values[at]);
      }
    }
  }
}

TEST_F(MrtrixLayoutTest, ScalingIsApplied) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto volume,
      OpenVolumeFile(Write("a.mif", MifBytes({.more = "scaling: 5,0.5\n"}, std::string(24, 'd')))));
  EXPECT_EQ(volume->info().type, ScalarType::kFloat32);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string samples, ReadAll(*volume, 1));
  EXPECT_EQ(samples, BytesOf(std::vector<float>(24, 55.0F)));
}

TEST_F(MrtrixLayoutTest, RefusesInASentence) {
  const std::vector<std::pair<Mif, const char*>> cases = {
      {{.dim = "4,3"}, "as many of each"},
      {{.dim = "4,0,2"}, "1 or more"},
      {{.dim = "4,x,2"}, "1 or more"},
      {{.dim = "4,3", .layout = "+0,+1"}, "2 axes"},
      {{.layout = "+0,+1,+1"}, "each rank"},
      {{.layout = "+0,+1,+3"}, "each rank"},
      {{.layout = "+0,+1,a"}, "each rank"},
      {{.dim = "2,3,2,2", .layout = "+0,+1,+3,+2"}, "mrconvert -strides 1,2,3,4"},
      {{.dim = "2,3,2,2", .layout = "+0,+1,+2,-3"}, "mrconvert -strides 1,2,3,4"},
      {{.dim = "2,3,2,2,2", .layout = "+0,+1,+2,+3,+4"}, "mrconvert -coord 4 0"},
      {{.type = "Bit"}, "mrconvert -datatype uint8"},
      {{.type = "CFloat32LE"}, "mrconvert -datatype float32"},
      {{.type = "Float32"}, "the byte order is not known"},
      {{.type = "UInt8LE"}, "no byte order"},
      {{.vox = "1,0,1"}, "--spacing"},
      {{.vox = "1,1"}, "--spacing"},
      {{.vox = "1,1,x"}, "expected numbers"},
      {{.transform = "transform: 1,0,0,0\n"}, "1 rows of the transform"},
      {{.transform = "transform: 1,0,0\ntransform: 0,1,0\ntransform: 0,0,1\n"}, "four numbers"},
      {{.transform = "transform: 1,0.5,0,0\ntransform: 0,1,0,0\ntransform: 0,0,1,0\n"},
       "--ignore-shear"},
      {{.more = "dim: 4,3,2\n"}, "2 lines \"dim\""},
      {{.more = "scaling: 1\n"}, "an offset and a factor"},
      {{.more = "scaling: 1,0\n"}, "an offset and a factor"},
      {{.type = "Int64LE", .more = "scaling: 1,2\n"}, "which is not read"},
      {{.file = ""}, "no line \"file\""},
      {{.file = "file: . 10\n"}, "where the header ends at byte"},
      {{.file = "file: a[0:2].dat 0\n"}, "brackets"},
      {{.file = "file: . 400\nfile: . 400\n"}, "one offset"},
      {{.dim = "40,30,20"}, "need 24400 bytes"}};
  for (const auto& [mif, message] : cases) {
    EXPECT_THAT(Error(mif), StatusIs(kInvalid, HasSubstr(message))) << message;
  }
  EXPECT_THAT(Error({.file = "file: none.dat 0\n"}),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("none.dat")));
  const std::string whole = MifBytes({}, std::string(24, 'a'));
  for (std::size_t size = 0; size < whole.size(); size += 7) {
    EXPECT_FALSE(OpenVolumeSeries(Write("cut.mif", whole.substr(0, size))).ok() &&
                 OpenVolumeFile(dir_.Sub("cut.mif")).ok())
        << size;
  }
}

TEST_F(MrtrixLayoutTest, ItsFilesAreTheHeaderAndThoseOfTheSamples) {
  Write("a.dat", std::string(24, 'a'));
  const std::string path = Write("a.mih", MifText({.file = "file: a.dat 0\n"}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfVolume(path));
  EXPECT_THAT(files, ::testing::ElementsAre(path, dir_.Sub("a.dat")));
  EXPECT_TRUE(IsMrtrixHeader("mrtrix image\n"));
  EXPECT_FALSE(IsMrtrixHeader("mrtrix tracks\n"));
}

}  // namespace
}  // namespace isoscope::source
