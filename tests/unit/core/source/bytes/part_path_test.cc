#include "core/source/bytes/part_path.h"

#include <string>
#include <vector>

#include "gtest/gtest.h"

namespace isoscope::source {
namespace {

TEST(PartPathTest, FilesAndTheirPartsAreTold) {
  const std::vector<std::string> endings{".vti", ".vtx"};
  const struct {
    const char* path;
    const char* file;
    const char* part;
  } rows[] = {{"v.vti", "v.vti", ""},
              {"/d/V.VTI", "/d/V.VTI", ""},
              {"v.vti:density", "v.vti", "density"},
              {"v.vtx:velocity:2", "v.vtx", "velocity:2"},
              {"c:v.vti:a b", "c:v.vti", "a b"},
              {"a:b.vti", "a:b.vti", ""}};
  for (const auto& row : rows) {
    PartPath parts;
    ASSERT_TRUE(SplitPartPath(row.path, endings, &parts)) << row.path;
    EXPECT_EQ(parts.file, row.file);
    EXPECT_EQ(parts.part, row.part);
  }
  for (const char* path : {"", ":", "v.nrrd", "v.nrrd:density", "v.vti.gz", "v.vti:"}) {
    PartPath parts;
    EXPECT_FALSE(SplitPartPath(path, endings, &parts)) << path;
  }
}

TEST(PartPathTest, AnEndingWithoutADotIsAWholeName) {
  PartPath parts;
  for (const char* path : {"2dseq", "/d/2dseq", "/d/2DSEQ"}) {
    ASSERT_TRUE(SplitPartPath(path, {"2dseq"}, &parts)) << path;
    EXPECT_EQ(parts.file, path);
  }
  ASSERT_TRUE(SplitPartPath("d/2dseq:isa 2", {"2dseq"}, &parts));
  EXPECT_EQ(parts.part, "isa 2");
  for (const char* path : {"my2dseq", "/d/my2dseq:part", "2dseq.nii", "seq"}) {
    EXPECT_FALSE(SplitPartPath(path, {"2dseq"}, &parts)) << path;
  }
}

}  // namespace
}  // namespace isoscope::source
