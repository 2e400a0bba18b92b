#include "core/formats/arrays/npy_series.h"

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/open_volume.h"
#include "core/source/volume_source.h"
#include "tests/support/folder_test.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/arrays/npy_bytes.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"
#include "tests/unit/core/source/bytes/zip_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::BytesOf;
using ::isoscope::testing::Gzip;
using ::isoscope::testing::NpyBytes;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::Swapped;
using ::isoscope::testing::ZipBytes;
using ::isoscope::testing::ZipEntry;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using volume::ScalarType;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr char kShape[] = "(2, 3, 4)";

template <typename T>
std::vector<T> NpyRamp() {
  std::vector<T> values;
  for (int i = 0; i < 24; ++i) {
    values.push_back(static_cast<T>(3 * i - 20));
  }
  return values;
}

struct NpyCase {
  std::string code;
  ScalarType type;
  std::size_t stored_size;
  std::string stored;   // little-endian
  std::string samples;  // as they are read
};

std::vector<NpyCase> NpyCases() {
  const std::vector<std::uint16_t> halves(24, 0x3e00);  // 1.5
  return {
      {"b1", ScalarType::kUint8, 1, std::string(24, '\1'), std::string(24, '\1')},
      {"u1", ScalarType::kUint8, 1, BytesOf(NpyRamp<std::uint8_t>()),
       BytesOf(NpyRamp<std::uint8_t>())},
      {"i1", ScalarType::kInt8, 1, BytesOf(NpyRamp<std::int8_t>()),
       BytesOf(NpyRamp<std::int8_t>())},
      {"u2", ScalarType::kUint16, 2, BytesOf(NpyRamp<std::uint16_t>()),
       BytesOf(NpyRamp<std::uint16_t>())},
      {"i2", ScalarType::kInt16, 2, BytesOf(NpyRamp<std::int16_t>()),
       BytesOf(NpyRamp<std::int16_t>())},
      {"u4", ScalarType::kUint32, 4, BytesOf(NpyRamp<std::uint32_t>()),
       BytesOf(NpyRamp<std::uint32_t>())},
      {"i4", ScalarType::kInt32, 4, BytesOf(NpyRamp<std::int32_t>()),
       BytesOf(NpyRamp<std::int32_t>())},
      {"f4", ScalarType::kFloat32, 4, BytesOf(NpyRamp<float>()), BytesOf(NpyRamp<float>())},
      {"f8", ScalarType::kFloat64, 8, BytesOf(NpyRamp<double>()), BytesOf(NpyRamp<double>())},
      {"i8", ScalarType::kFloat64, 8, BytesOf(NpyRamp<std::int64_t>()), BytesOf(NpyRamp<double>())},
      {"u8", ScalarType::kFloat64, 8, BytesOf(std::vector<std::uint64_t>(24, 7)),
       BytesOf(std::vector<double>(24, 7))},
      {"f2", ScalarType::kFloat32, 2, BytesOf(halves), BytesOf(std::vector<float>(24, 1.5F))}};
}

class NpySeriesTest : public testing::FolderTest {};

TEST_F(NpySeriesTest, EveryTypeInBothByteOrdersPlainAndPacked) {
  for (const NpyCase& c : NpyCases()) {
    for (const bool is_big_endian : {false, true}) {
      for (const bool is_fortran : {false, true}) {
        const std::string order = c.stored_size == 1 ? "|" : is_big_endian ? ">" : "<";
        const std::string bytes =
            NpyBytes(order + c.code, kShape,
                     is_big_endian ? Swapped(c.stored, c.stored_size) : c.stored, is_fortran);
        for (const std::string& path :
             {Write("a.npy", bytes), Write("a.npy.gz", Gzip(bytes)), Write("noname", bytes),
              Write("a.npz", ZipBytes({{.name = "a.npy", .bytes = bytes}})),
              Write("noname2", ZipBytes({{.name = "a.npy", .bytes = bytes, .is_deflated = true}},
                                        {.is_long = true}))}) {
          SCOPED_TRACE(absl::StrCat(path, " ", order, c.code));
          ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenVolumeFile(path));
          EXPECT_EQ(volume->info().type, c.type);
          EXPECT_EQ(volume->info().geometry.sample_dims,
                    is_fortran ? (math::Index3{2, 3, 4}) : (math::Index3{4, 3, 2}));
          for (const std::int64_t planes : {1, 5}) {
            ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string samples, ReadAll(*volume, planes));
            EXPECT_EQ(samples, c.samples);
          }
        }
      }
    }
  }
}

TEST_F(NpySeriesTest, AnElementLiesWhereItsIndicesSayInEitherOrder) {
  // array[z, y, x] = 100 z + 10 y + x, stored in both orders.
  std::string c_order;
  std::string f_order;
  for (int i = 0; i < 24; ++i) {
    c_order += static_cast<char>(100 * (i / 12) + 10 * (i / 4 % 3) + i % 4);
    f_order += static_cast<char>(100 * (i % 2) + 10 * (i / 2 % 3) + i / 6);
  }
  for (const bool is_fortran : {false, true}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const auto volume,
        OpenVolumeFile(
            Write("a.npy", NpyBytes("|u1", kShape, is_fortran ? f_order : c_order, is_fortran))));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string samples, ReadAll(*volume, 1));
    const volume::GridGeometry& grid = volume->info().geometry;
    const math::Index3& dims = grid.sample_dims;
    for (std::int64_t i = 0; i < 24; ++i) {
      const math::Vec3d at =
          math::TransformPoint(grid.world_from_index(), {static_cast<double>(i % dims.x),
                                                         static_cast<double>(i / dims.x % dims.y),
                                                         static_cast<double>(i / dims.x / dims.y)});
      EXPECT_EQ(static_cast<unsigned char>(samples[static_cast<std::size_t>(i)]),
                100 * at.z + 10 * at.y + at.x);
    }
  }
}

TEST_F(NpySeriesTest, MembersOfAnArchiveAreFields) {
  const std::string bytes(24, 'a');
  const std::string path =
      Write("run.npz",
            ZipBytes({{.name = "step.npy", .bytes = NpyBytes("<f8", "()", std::string(8, '\0'))},
                      {.name = "p.npy", .bytes = NpyBytes("|u1", kShape, bytes)},
                      {.name = "what.npy", .bytes = NpyBytes("|O", kShape, "pickle")},
                      {.name = "q.npy",
                       .bytes = NpyBytes("<f4", kShape, BytesOf(NpyRamp<float>())),
                       .is_deflated = true},
                      {.name = "deep/r.npy", .bytes = NpyBytes("|u1", "(3, 3, 3)", bytes + "bcd")},
                      {.name = "notes.txt", .bytes = "hello"}}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path));
  ASSERT_EQ(series->info().fields.size(), 2U);
  EXPECT_EQ(series->info().field(0).name, "p");
  EXPECT_EQ(series->info().field(1).name, "q");
  EXPECT_THAT(series->info().fields_elsewhere, ElementsAre("deep/r"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto q, series->Open(1, 0, 0));
  EXPECT_EQ(q->info().type, ScalarType::kFloat32);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string samples, ReadAll(*q, 1));
  EXPECT_EQ(samples, BytesOf(NpyRamp<float>()));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto r, OpenVolumeFile(path + ":deep/r"));
  EXPECT_EQ(r->info().geometry.sample_dims, (math::Index3{3, 3, 3}));
  EXPECT_THAT(OpenVolumeSeries(path + ":what"), StatusIs(kInvalid, HasSubstr("a pickle")));
  EXPECT_THAT(OpenVolumeSeries(path + ":step"), StatusIs(kInvalid, HasSubstr("shape ()")));
  EXPECT_THAT(
      OpenVolumeSeries(path + ":x"),
      StatusIs(absl::StatusCode::kNotFound,
               AllOf(HasSubstr("no array \"x\""), HasSubstr("it holds step, p, what, q, deep/r"))));
}

// Each of four axes, in either order: the element at (t, z, y, x) is 1000 t + 100 z + 10 y + x.
TEST_F(NpySeriesTest, AFourthAxisIsStepsOrComponents) {
  constexpr std::int64_t kCount = 5;
  constexpr math::Index3 kSize{4, 3, 2};
  for (const bool is_fortran : {false, true}) {
    for (const std::string axes : {"TZYX", "CZYX", "ZYXT", "ZYXC"}) {
      SCOPED_TRACE(absl::StrCat(axes, is_fortran));
      const bool is_first = axes[0] != 'Z';
      const std::vector<std::int64_t> shape = is_first ? std::vector<std::int64_t>{kCount, 2, 3, 4}
                                                       : std::vector<std::int64_t>{2, 3, 4, kCount};
      std::vector<std::uint16_t> stored;
      for (std::int64_t i = 0; i < kCount * 24; ++i) {
        std::vector<std::int64_t> index(4);
        std::int64_t rest = i;
        for (std::size_t k = 0; k < 4; ++k) {
          const std::size_t axis = is_fortran ? k : 3 - k;
          index[axis] = rest % shape[axis];
          rest /= shape[axis];
        }
        const std::size_t z = is_first ? 1 : 0;
        stored.push_back(static_cast<std::uint16_t>(
            1000 * index[is_first ? 0 : 3] + 100 * index[z] + 10 * index[z + 1] + index[z + 2]));
      }
      const std::string path =
          Write("a.npy", NpyBytes("<u2", absl::StrCat("(", absl::StrJoin(shape, ", "), ")"),
                                  BytesOf(stored), is_fortran));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenNpySeries(path, "a", axes));
      const bool are_steps = absl::StrContains(axes, 'T');
      EXPECT_EQ(series->info().step_count(), are_steps ? kCount : 1);
      EXPECT_EQ(series->info().fields[0].components.size(), are_steps ? 1U : 5U);
      for (int i = 0; i < kCount; ++i) {
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume,
                                      series->Open(0, are_steps ? 0 : i, are_steps ? i : 0));
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*volume, 1));
        std::vector<std::uint16_t> expected;
        for (std::int64_t k = 0; k < 24; ++k) {
          const std::int64_t x = is_fortran ? k / (kSize.z * kSize.y) : k % kSize.x;
          const std::int64_t y = is_fortran ? k / kSize.z % kSize.y : k / kSize.x % kSize.y;
          const std::int64_t z = is_fortran ? k % kSize.z : k / (kSize.x * kSize.y);
          expected.push_back(static_cast<std::uint16_t>(1000 * i + 100 * z + 10 * y + x));
        }
        EXPECT_EQ(read, BytesOf(expected));
      }
    }
  }
}

TEST_F(NpySeriesTest, RefusesInASentence) {
  const std::string samples = BytesOf(NpyRamp<float>());
  const std::string good = NpyBytes("<f4", kShape, samples);
  struct Case {
    const char* name;
    std::string bytes;
    const char* message;
  };
  const auto npz = [](ZipEntry entry) { return ZipBytes({std::move(entry)}); };
  for (const Case& c : std::vector<Case>{
           {"a.npy", good.substr(0, good.size() - 1), "need 224 bytes, the file has 223"},
           {"a.npy", "text", "does not begin with"},
           {"a.npy", NpyBytes("|O", kShape, ""), "a pickle"},
           {"a.npz", npz({.name = "a.txt", .bytes = "1"}), "ZIP"},
           {"a.npz", npz({.name = "a.npy", .bytes = good + "x"}),
            "needs 224 bytes, the member has 225"},
           {"a.npz", npz({.name = "a.npy", .bytes = good.substr(0, 200)}), "the member has 200"},
           {"a.npz", npz({.name = "a.npy", .bytes = NpyBytes("|O", kShape, "")}), "a pickle"},
           {"a.npz", npz({.name = "a\n.npy", .bytes = good}), "a name that no field has"},
           {"a.npz", npz({.name = "a.npy", .bytes = good, .flags = 1}), "is encrypted"},
           {"a.npz", ZipBytes({{.name = "a.npy", .bytes = good}}).substr(0, 200),
            "the file is cut"}}) {
    EXPECT_THAT(OpenVolumeFile(Write(c.name, c.bytes)), StatusIs(kInvalid, HasSubstr(c.message)))
        << c.message;
  }
}

TEST_F(NpySeriesTest, DamagedSamplesAreDataLoss) {
  const std::string good = NpyBytes("|u1", kShape, std::string(24, 'a'));
  for (const bool is_deflated : {false, true}) {
    const std::string path =
        Write("a.npz",
              ZipBytes({{.name = "a.npy", .bytes = good, .is_deflated = is_deflated, .crc = 1}}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenVolumeFile(path));
    EXPECT_THAT(ReadAll(*volume, 1),
                StatusIs(absl::StatusCode::kDataLoss, HasSubstr("its checksum is")));
  }
}

TEST_F(NpySeriesTest, ContentIsKnown) {
  EXPECT_TRUE(IsNpy(NpyBytes("<f4", kShape, "")));
  EXPECT_FALSE(IsNpy("NUMPY"));
  EXPECT_TRUE(IsNpz(ZipBytes({{.name = "a.npy", .bytes = ""}})));
  EXPECT_FALSE(IsNpz(ZipBytes({{.name = "a.txt", .bytes = ""}})));
}

}  // namespace
}  // namespace isoscope::source
