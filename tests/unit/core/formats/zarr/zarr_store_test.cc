#include "core/formats/zarr/zarr_store.h"

#include <memory>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/memory_store.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/core/formats/zarr/zarr_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::Objects;
using ::isoscope::testing::OpenObjects;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::Zarr2Text;
using ::isoscope::testing::Zarr3Group;
using ::isoscope::testing::Zarr3Text;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr auto kNotFound = absl::StatusCode::kNotFound;

TEST(ZarrStoreTest, ReadsNodesOfBothVersions) {
  const Objects v2 = {
      {".zgroup", "{\"zarr_format\": 2}"},   {".zattrs", "{\"title\": NaN}"},
      {"g/.zgroup", "{\"zarr_format\": 2}"}, {"g/a/.zarray", Zarr2Text({4}, {2}, "<u2")},
      {"g/a/.zattrs", "{\"units\": \"m\"}"}, {"g/text/.zarray", Zarr2Text({4}, {2}, "<U3")}};
  const Objects v3 = {
      {"zarr.json", Zarr3Group("{\"title\": \"NaN\"}")},
      {"g/zarr.json", Zarr3Group()},
      {"g/a/zarr.json", Zarr3Text({4}, {2}, "uint16", ", \"attributes\": {\"units\": \"m\"}")},
      {"g/text/zarr.json", Zarr3Text({4}, {2}, "string")}};
  for (const Objects& objects : {v2, v3}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto store, OpenObjects(objects));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrNode root, store->Node(""));
    EXPECT_FALSE(root.is_array);
    EXPECT_EQ(root.attributes["title"], "NaN");
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrNode array, store->Node("g/a"));
    EXPECT_TRUE(array.is_array);
    ISOSCOPE_ASSERT_OK(array.array);
    EXPECT_EQ(array.array->attributes["units"], "m");
    EXPECT_EQ(array.array->path, "g/a");
    // An array that we can't read is still one.
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrNode text, store->Node("g/text"));
    EXPECT_TRUE(text.is_array);
    EXPECT_THAT(text.array, StatusIs(kInvalid, HasSubstr("memory:g/text")));
    EXPECT_THAT(store->Node("g/none"), StatusIs(kNotFound));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto children, store->Children("g"));
    EXPECT_THAT(children, ::testing::IsSupersetOf({"g/a", "g/text"}));
    for (const char* bad : {"g//a", "../g", "g/.", "/g", "g/", "a\\..\\b/.."}) {
      EXPECT_THAT(store->Node(bad), StatusIs(kInvalid)) << bad;
    }
  }
}

// Each document that may be there costs a request at an address.
TEST(ZarrStoreTest, NodesHaveTheVersionOfTheRootWhereNothingLists) {
  const auto keys_of = [](const Objects& objects) {
    const auto store = std::make_shared<const testing::MemoryStore>(objects);
    const auto zarr = ZarrStore::Open(store, nullptr);
    EXPECT_EQ(store->TakeReads().size(), 5U);  // of the root
    EXPECT_TRUE((*zarr)->Node("a").ok());
    std::vector<std::string> keys;
    for (const ObjectRead& read : store->TakeReads()) {
      keys.push_back(read.key);
    }
    return keys;
  };
  EXPECT_THAT(keys_of({{"zarr.json", Zarr3Group()},
                       {"a/zarr.json", Zarr3Text({4}, {2}, "uint16")},
                       {"a/.zarray", "{"}}),
              ElementsAre("a/zarr.json"));
  EXPECT_THAT(keys_of({{".zgroup", "{\"zarr_format\": 2}"},
                       {"a/.zarray", Zarr2Text({4}, {2}, "<u2")},
                       {"a/zarr.json", "{"}}),
              ElementsAre("a/.zarray", "a/.zgroup", "a/.zattrs"));
  // On a disk a group of Zarr 3 may stand around a store of Zarr 2.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto mixed,
      OpenObjects({{"zarr.json", Zarr3Group()}, {"old/.zarray", Zarr2Text({4}, {2}, "<u2")}}));
  EXPECT_TRUE(mixed->Node("old").ok());
}

TEST(ZarrStoreTest, TakesConsolidatedMetadata) {
  const Objects v2 = {
      {".zgroup", "{\"zarr_format\": 2}"},
      {".zmetadata",
       absl::StrCat(R"({"zarr_consolidated_format": 1, "metadata": {".zgroup": {"zarr_format": 2},
                        "g/.zgroup": {"zarr_format": 2}, "g/a/.zattrs": {"units": "m"}, "x": 3,
                        "g/a/.zarray": )",
                    Zarr2Text({4}, {2}, "<u2"), "}}")}};
  const Objects v3 = {
      {"zarr.json",
       absl::StrCat(R"({"zarr_format": 3, "node_type": "group", "consolidated_metadata":
                        {"kind": "inline", "must_understand": false, "metadata": {"g": )",
                    Zarr3Group(), ", \"g/a\": ",
                    Zarr3Text({4}, {2}, "uint16", ", \"attributes\": {\"units\": \"m\"}"), "}}}")}};
  for (const Objects& objects : {v2, v3}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto store, OpenObjects(objects, /*is_listed=*/false));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto top, store->Children(""));
    EXPECT_THAT(top, ElementsAre("g"));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto below, store->Children("g"));
    EXPECT_THAT(below, ElementsAre("g/a"));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrNode node, store->Node("g/a"));
    EXPECT_EQ(node.attributes["units"], "m");
    ISOSCOPE_EXPECT_OK(node.array);
  }
}

TEST(ZarrStoreTest, RefusesWhatIsNoStore) {
  EXPECT_THAT(OpenObjects({{"a", "b"}}), StatusIs(kNotFound, HasSubstr("no Zarr store")));
  EXPECT_THAT(OpenObjects({{"zarr.json", "{"}}), StatusIs(kInvalid, HasSubstr("memory/zarr.json")));
  EXPECT_THAT(OpenObjects({{".zgroup", "{}"}, {".zmetadata", "[]"}}), StatusIs(kInvalid));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto store, OpenObjects({{"zarr.json", R"({"zarr_format": 3, "node_type": "tree"})"}}));
  EXPECT_THAT(store->Node(""), StatusIs(kInvalid, HasSubstr("\"tree\"")));
}

}  // namespace
}  // namespace isoscope::source
