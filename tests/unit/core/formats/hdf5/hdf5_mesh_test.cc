#include "core/formats/hdf5/hdf5_mesh.h"

#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/hdf5_mesh_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::Hdf5MeshWriter;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

TEST(Hdf5MeshTest, ReadsNumbersAndNames) {
  const testing::TempDir dir;
  Hdf5MeshWriter writer(dir.Sub("a.h5"));
  writer.Group("/b");
  writer.Group("/a");
  writer.Numbers("/a", "numbers", {1.5, 2, 3});
  writer.Texts("/a", "text", {"1"});
  writer.Numbers("/a", "many", std::vector<double>(65, 1));
  const Hdf5Handle group(H5Gopen2(writer.file(), "/a", H5P_DEFAULT), H5Gclose);
  EXPECT_THAT(Hdf5Numbers(group.get(), "numbers"), ElementsAre(1.5, 2, 3));
  EXPECT_THAT(Hdf5Numbers(group.get(), "text"), IsEmpty());
  EXPECT_THAT(Hdf5Numbers(group.get(), "many"), IsEmpty());
  EXPECT_THAT(Hdf5Numbers(group.get(), "none"), IsEmpty());
  const Hdf5Handle root(H5Gopen2(writer.file(), "/", H5P_DEFAULT), H5Gclose);
  EXPECT_THAT(Hdf5NamesIn(root.get()), ElementsAre("a", "b"));
  EXPECT_THAT(Hdf5NamesIn(-1), IsEmpty());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto meshes, FindHdf5Meshes(writer.file()));
  EXPECT_FALSE(meshes.has_value());
}

}  // namespace
}  // namespace isoscope::source
