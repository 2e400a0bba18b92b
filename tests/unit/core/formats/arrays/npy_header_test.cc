#include "core/formats/arrays/npy_header.h"

#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/unit/core/formats/arrays/npy_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::NpyBytes;
using ::isoscope::testing::NpyWithText;
using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

TEST(NpyHeaderTest, VersionsAndWhatPythonMayWrite) {
  for (const int version : {1, 2, 3}) {
    const std::string bytes = NpyBytes(">f4", "(2, 3, 4)", "", true, version);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const NpyHeader header, ParseNpyHeader(bytes, "a.npy"));
    EXPECT_EQ(header.type, volume::ScalarType::kFloat32);
    EXPECT_TRUE(header.is_big_endian);
    EXPECT_TRUE(header.is_fortran);
    EXPECT_THAT(header.shape, ElementsAre(2, 3, 4));
    EXPECT_EQ(header.samples_start, static_cast<std::int64_t>(bytes.size()));
    EXPECT_EQ(header.samples_start % 64, 0);
    EXPECT_EQ(header.SampleCount(), 24);
  }
  for (const char* text : {"{'shape': (2L, 3L, 4L), 'fortran_order': False, 'descr': '<i2'}",
                           "{ \"descr\" : \"<i2\", \"fortran_order\":False,\"shape\":(2,3,4,),}"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const NpyHeader header,
                                  ParseNpyHeader(NpyWithText(text, ""), "a.npy"));
    EXPECT_EQ(header.type, volume::ScalarType::kInt16);
    EXPECT_FALSE(header.is_fortran);
    EXPECT_THAT(header.shape, ElementsAre(2, 3, 4));
  }
  EXPECT_TRUE(IsNpyHeader(NpyBytes("<f4", "()", "")));
  EXPECT_FALSE(IsNpyHeader("\x93NUMP"));
}

TEST(NpyHeaderTest, TypesThatNoVolumeHasAreNamed) {
  const std::vector<std::pair<const char*, const char*>> cases = {
      {"|O", "Python objects, which are a pickle"},
      {"<c8", "complex numbers"},
      {"|V8", "records"},
      {"<U4", "texts"},
      {"|S4", "texts"},
      {"<M8[ns]", "dates or times"},
      {"<f16", "a type that no volume has"},
      {"<i3", "a type that no volume has"},
      {"", "a type that no volume has"},
      {"f4", "a type that no volume has"},
      {"|f4", "does not say the byte order"},
      {"=i2", "does not say the byte order"},
      {"!f4", "a type that no volume has"}};
  for (const auto& [descr, message] : cases) {
    EXPECT_THAT(ParseNpyHeader(NpyBytes(descr, "(2, 2, 2)", ""), "a.npy"),
                StatusIs(kInvalid, AllOf(HasSubstr("a.npy: NumPy header: "), HasSubstr(message))))
        << descr;
  }
  EXPECT_THAT(ParseNpyHeader(NpyWithText("{'descr': [('a', '<f4')], 'fortran_order': False, "
                                         "'shape': (2, 2, 2), }",
                                         ""),
                             "a.npy"),
              StatusIs(kInvalid, HasSubstr("a structured array")));
}

TEST(NpyHeaderTest, OtherTextsAreRefused) {
  const std::string d = "'descr': '<f4'";
  const std::string f = "'fortran_order': False";
  const std::string s = "'shape': (2, 2, 2)";
  for (const std::string& text :
       {std::string(), std::string("{}"), absl::StrCat("{", d, ", ", f, "}"),
        absl::StrCat("{", d, ", ", f, ", ", s), absl::StrCat(d, ", ", f, ", ", s),
        absl::StrCat("{", d, ", ", d, ", ", f, ", ", s, "}"),
        absl::StrCat("{", d, ", ", f, ", ", s, ", 'x': 1}"),
        absl::StrCat("{", d, " ", f, ", ", s, "}"), absl::StrCat("{", d, ", ", f, ", ", s, "} x"),
        absl::StrCat("{", d, ", 'fortran_order': 0, ", s, "}"),
        absl::StrCat("{", d, ", ", f, ", 'shape': 8}"),
        absl::StrCat("{", d, ", ", f, ", 'shape': (8)}"),
        absl::StrCat("{", d, ", ", f, ", 'shape': (2 2, 2)}"),
        absl::StrCat("{", d, ", ", f, ", 'shape': (-2, 2, 2)}"),
        absl::StrCat("{", d, ", ", f, ", 'shape': (99999999999999999999, 2, 2)}"),
        absl::StrCat("{", d, ", ", f, ", 'shape': (2, 2, 2"),
        absl::StrCat("{'descr': '<f\\x34', ", f, ", ", s, "}"),
        absl::StrCat("{'descr': __import__('os'), ", f, ", ", s, "}"),
        absl::StrCat(
            "{", d, ", ", f, ", 'shape': (1", std::string(40 * 3, ' '),
            [] {
              std::string ones;
              for (int i = 0; i < 40; ++i) {
                ones += ", 1";
              }
              return ones;
            }(),
            ")}")}) {
    EXPECT_THAT(ParseNpyHeader(NpyWithText(text, ""), "a.npy"),
                StatusIs(kInvalid, HasSubstr("a.npy: NumPy header: ")))
        << text;
  }
}

TEST(NpyHeaderTest, EachCutIsAnError) {
  const std::string whole = NpyBytes("<f4", "(2, 2, 2)", "");
  for (std::size_t size = 0; size < whole.size(); ++size) {
    EXPECT_THAT(ParseNpyHeader(whole.substr(0, size), "a.npy"), StatusIs(kInvalid)) << size;
  }
  for (const int version : {0, 4, 200}) {
    EXPECT_THAT(ParseNpyHeader(NpyBytes("<f4", "(2, 2, 2)", "", false, version), "a.npy"),
                StatusIs(kInvalid, HasSubstr(absl::StrCat("version ", version, ".0"))));
  }
  std::string huge = NpyBytes("<f4", "(2, 2, 2)", "", false, 2);
  huge.replace(8, 4, "\xff\xff\xff\x7f");
  EXPECT_THAT(ParseNpyHeader(huge, "a.npy"),
              StatusIs(kInvalid, HasSubstr("2147483647 bytes of header; expected at most 65536")));
}

TEST(NpyHeaderTest, TheGridHasTheLastIndexAlongX) {
  const auto grid = [](std::vector<std::int64_t> shape, bool is_fortran = false) {
    return NpyGrid({.is_fortran = is_fortran, .shape = std::move(shape)}, "a.npy");
  };
  for (const auto& shape : std::vector<std::vector<std::int64_t>>{
           {2, 3, 4}, {1, 2, 3, 4}, {2, 3, 4, 1}, {1, 1, 2, 3, 4, 1}}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const volume::GridGeometry c, grid(shape));
    EXPECT_EQ(c.sample_dims, (math::Index3{4, 3, 2}));
    EXPECT_EQ(c.direction, math::Mat3d());
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const volume::GridGeometry f, grid(shape, true));
    EXPECT_EQ(f.sample_dims, (math::Index3{2, 3, 4}));
    // The stored axis x is z of the array.
    const math::Vec3d at = math::TransformPoint(f.world_from_index(), {1, 2, 3});
    EXPECT_EQ(at, (math::Vec3d{3, 2, 1}));
  }
  for (const auto& shape : std::vector<std::vector<std::int64_t>>{
           {}, {8}, {2, 3}, {1, 2, 3}, {2, 3, 4, 5}, {2, 1, 3, 4}, {0, 3, 4}, {2, 3, 20'000'000}}) {
    EXPECT_THAT(grid(shape), StatusIs(kInvalid, HasSubstr("a.npy: ")));
  }
  EXPECT_THAT(grid({5, 2, 3, 4}), StatusIs(kInvalid, HasSubstr("numpy.save(FILE, array[0])")));
}

TEST(NpyHeaderTest, LettersSayWhatAFourthAxisIs) {
  const auto volumes_of = [](const char* shape, const std::string& axes,
                             bool is_fortran = false) -> absl::StatusOr<NpyVolumes> {
    const auto header = ParseNpyHeader(NpyBytes("<u2", shape, "", is_fortran), "a.npy");
    return header.ok() ? NpyVolumesOf(*header, axes, "a.npy") : header.status();
  };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const NpyVolumes steps, volumes_of("(5, 2, 3, 4)", "TZYX"));
  EXPECT_EQ(steps.geometry.sample_dims, (math::Index3{4, 3, 2}));
  EXPECT_EQ(steps.count, 5);
  EXPECT_TRUE(steps.are_steps);
  EXPECT_FALSE(steps.are_fastest);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const NpyVolumes colours, volumes_of("(2, 3, 4, 5)", "zyxc"));
  EXPECT_EQ(colours.count, 5);
  EXPECT_FALSE(colours.are_steps);
  EXPECT_TRUE(colours.are_fastest);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const NpyVolumes fortran, volumes_of("(2, 3, 4, 5)", "ZYXT", true));
  EXPECT_EQ(fortran.geometry.sample_dims, (math::Index3{2, 3, 4}));
  EXPECT_FALSE(fortran.are_fastest);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const NpyVolumes one, volumes_of("(1, 2, 3, 1, 4)", "TZYCX"));
  EXPECT_EQ(one.count, 1);
  EXPECT_EQ(one.geometry.sample_dims, (math::Index3{4, 3, 2}));
  const struct {
    const char* shape;
    const char* axes;
    const char* said;
  } kBad[] = {{"(5, 2, 3, 4)", "ZYX", "such as TZYX"},
              {"(5, 2, 3, 4)", "TZXY", "--axes TZXY"},
              {"(5, 2, 3, 4)", "QZYX", "--axes QZYX"},
              {"(5, 2, 3, 4)", "-ZYX", "one of T and C"},
              {"(5, 2, 2, 3, 4)", "TCZYX", "one of T and C"},
              {"(2, 5, 3, 4)", "ZTYX", "numpy.moveaxis(array, 1, 0)"},
              {"(5, 2, 1, 4)", "TZYX", "a.npy"}};
  for (const auto& bad : kBad) {
    EXPECT_THAT(volumes_of(bad.shape, bad.axes), StatusIs(kInvalid, HasSubstr(bad.said)))
        << bad.axes;
  }
}

TEST(NpyHeaderTest, CountsBeyondAnyFileAreKnown) {
  constexpr std::int64_t kMost = std::numeric_limits<std::int64_t>::max();
  EXPECT_EQ((NpyHeader{.shape = {kMost, kMost}}.SampleCount()), -1);
  EXPECT_EQ((NpyHeader{.shape = {kMost, 0}}.SampleCount()), 0);
  EXPECT_EQ((NpyHeader{.shape = {}}.SampleCount()), 1);
}

}  // namespace
}  // namespace isoscope::source
