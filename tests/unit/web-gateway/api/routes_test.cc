#include "web-gateway/api/routes.h"

#include <set>
#include <string>
#include <vector>

#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace isoscope::gateway {
namespace {

std::vector<std::string> SegmentsOf(const std::string& path) {
  return absl::StrSplit(path.substr(1), '/');
}

TEST(RoutesTest, EachOperationIsFoundAtItsAddressByItsMethodAlone) {
  std::set<std::string> names;
  for (const Operation& operation : Operations()) {
    EXPECT_TRUE(names.insert(operation.name).second) << operation.name << " is there twice";
    const std::string path = absl::StrReplaceAll(operation.path, {{"{name}", "a/b"}});
    std::vector<std::string> segments = SegmentsOf(operation.path);
    for (std::string& segment : segments) {
      if (segment == "{name}") {
        segment = "a/b";  // a name may have a slash
      }
    }
    const FoundRoute found = FindRoute(operation.method, segments);
    EXPECT_EQ(found.operation, &operation) << path;
    EXPECT_EQ(FindRoute("PUT", segments).operation, nullptr) << path;
    EXPECT_EQ(FindRoute("PUT", segments).methods, found.methods) << path;
    segments.emplace_back("x");
    EXPECT_NE(FindRoute(operation.method, segments).operation, &operation) << path << "/x";
  }
}

TEST(RoutesTest, AnAddressTellsItsMethods) {
  EXPECT_EQ(FindRoute("GET", {"v1", "datasets", "d", "render"}).methods, "GET, HEAD, POST");
  EXPECT_EQ(FindRoute("GET", {"v1", "datasets", "d", "pick"}).methods, "POST");
  EXPECT_EQ(FindRoute("POST", {"v1", "datasets"}).methods, "GET, HEAD");
  for (const std::vector<std::string>& none :
       {std::vector<std::string>{}, {"v1"}, {"v1", "none"}, {"v1", "datasets", "d", "mesh.exe"}}) {
    EXPECT_EQ(FindRoute("GET", none).methods, "");
  }
}

TEST(RoutesTest, EachFormatOfMeshesHasAnAddress) {
  for (const client::MeshFormat format : client::kMeshFormats) {
    const FoundRoute found =
        FindRoute("GET", {"v1", "datasets", "d", "mesh." + std::string(client::NameOf(format))});
    ASSERT_NE(found.operation, nullptr);
    EXPECT_EQ(found.operation->mesh_format, format);
  }
}

TEST(RoutesTest, EachFormatOfFilmsHasAnAddress) {
  for (const client::AnimationFormat format : client::kAnimationFormats) {
    const FoundRoute found =
        FindRoute("GET", {"v1", "datasets", "d", "film." + std::string(client::NameOf(format))});
    ASSERT_NE(found.operation, nullptr);
    EXPECT_EQ(found.operation->film_format, format);
    EXPECT_EQ(found.operation->media_types[0], "image/" + std::string(client::NameOf(format)));
  }
}

// A place is what --max-pictures counts.
TEST(RoutesTest, WhatCostsWorkTakesAPlace) {
  for (const Operation& operation : Operations()) {
    const bool is_work =
        operation.endpoint == Endpoint::kPicture ||
        operation.endpoint == Endpoint::kPostedPicture || operation.endpoint == Endpoint::kPick ||
        operation.endpoint == Endpoint::kMesh || operation.endpoint == Endpoint::kFilm;
    EXPECT_EQ(operation.takes_place(), is_work) << operation.name;
    const bool names_dataset = operation.path.find("{name}") != std::string::npos;
    EXPECT_EQ(operation.is_of_dataset(), names_dataset) << operation.name;
  }
}

}  // namespace
}  // namespace isoscope::gateway
