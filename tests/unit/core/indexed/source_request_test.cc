#include "core/indexed/source_request.h"

#include <map>
#include <optional>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::indexed {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;
using ::testing::Pair;
using ::testing::UnorderedElementsAre;

TEST(SourceRequestTest, ComesBack) {
  source::OpenRequest request{.path = "/data/run.raw"};
  request.raw = {.dims = {512, 256, 128},
                 .type = volume::ScalarType::kUint16,
                 .is_big_endian = true,
                 .header_bytes = 352};
  request.crop = {.begin = {0, 1, 2}, .end = {64, 65, 66}};
  request.stride = 3;
  request.fill = -0.1;
  request.steps = {.first = 2, .last = 2, .stride = 1};
  request.fields = {"u, v", "w"};
  request.axes = "ZYX";
  request.ignores_shear = true;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto members, EncodeSourceRequest(request));
  EXPECT_THAT(members, UnorderedElementsAre(Pair("path", "/data/run.raw"),
                                            Pair("raw", "512,256,128 uint16 big 352"),
                                            Pair("crop", "0:64,1:65,2:66"), Pair("stride", "3"),
                                            Pair("fill", "-0.10000000000000001"),
                                            Pair("steps", "2:2:1"), Pair("fields", "u, v\nw"),
                                            Pair("axes", "ZYX"), Pair("ignores_shear", "yes")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const source::OpenRequest again, DecodeSourceRequest(members, "d"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string expected, source::Describe(request));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string found, source::Describe(again));
  EXPECT_EQ(found, expected);
}

TEST(SourceRequestTest, LeavesOutWhatTheManifestHas) {
  source::OpenRequest request{.path = "/data/a.zarr/0"};
  request.grid.spacing = {1, 2, 3};
  request.time = 4;
  request.label_names = "/data/names.txt";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto members, EncodeSourceRequest(request));
  EXPECT_THAT(members, UnorderedElementsAre(Pair("path", "/data/a.zarr/0")));
  // Of an address nothing is a link.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto address,
                                EncodeSourceRequest({.path = "https://example.org/a.zarr"}));
  EXPECT_EQ(address.at("path"), "https://example.org/a.zarr");
}

TEST(SourceRequestTest, NamesAVolumeOfSeveral) {
  std::map<std::string, std::string> members = {{"path", "/data/a.zarr"}};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(std::optional<SourceVolume> volume,
                                DecodeSourceVolume(members, "d"));
  EXPECT_EQ(volume, std::nullopt);
  members["volume_field"] = "a\nb";
  members["volume_component"] = "3";
  members["volume_step"] = "17";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(volume, DecodeSourceVolume(members, "d"));
  EXPECT_EQ(volume, (SourceVolume{.field = "a\nb", .component = 3, .step = 17}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const source::OpenRequest request,
                                DecodeSourceRequest(members, "d"));
  EXPECT_EQ(request.path, "/data/a.zarr");
  for (const auto& [name, text] : std::map<std::string, std::string>{
           {"volume_component", "-1"}, {"volume_component", "x"}, {"volume_step", ""}}) {
    std::map<std::string, std::string> bad = members;
    bad[name] = text;
    EXPECT_THAT(DecodeSourceVolume(bad, "d"), StatusIs(absl::StatusCode::kDataLoss)) << name;
  }
  members.erase("volume_step");
  EXPECT_THAT(DecodeSourceVolume(members, "d"),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("volume_step")));
}

TEST(SourceRequestTest, RefusesWhatIsNone) {
  for (const auto& [name, text] : std::map<std::string, std::string>{{"path", ""},
                                                                     {"raw", "1,2 uint8 little 0"},
                                                                     {"crop", "1:2"},
                                                                     {"stride", "0"},
                                                                     {"fill", "x"},
                                                                     {"steps", "1:2"},
                                                                     {"ignores_shear", "no"}}) {
    EXPECT_THAT(DecodeSourceRequest({{name, text}}, "dataset d"),
                StatusIs(absl::StatusCode::kDataLoss, HasSubstr(name)))
        << name;
  }
  for (const char* raw : {"0,2,3 uint8 little 0", "1,2,3 bits little 0", "1,2,3 uint8 middle 0",
                          "1,2,3 uint8 big -1", "1,2,3 uint8 big"}) {
    EXPECT_THAT(DecodeSourceRequest({{"raw", raw}}, "d"), StatusIs(absl::StatusCode::kDataLoss))
        << raw;
  }
  EXPECT_THAT(DecodeSourceRequest({{"path", "/a"}, {"warp", "9"}}, "dataset d"),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("warp")));
  EXPECT_THAT(EncodeSourceRequest({.path = "/a", .fields = {"u\nv"}}),
              StatusIs(absl::StatusCode::kInvalidArgument));
}

}  // namespace
}  // namespace isoscope::indexed
