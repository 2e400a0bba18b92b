#include "core/source/hdf5/hdf5_path.h"

#include <filesystem>
#include <string>

#include "gtest/gtest.h"
#include <sys/stat.h>

#include "tests/support/folder_test.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

const std::string kSignature("\x89HDF\r\n\x1a\n", 8);

class Hdf5PathTest : public testing::FolderTest {
 protected:
};

TEST_F(Hdf5PathTest, ColonsInFoldersAndDatasetsAreNoEndOfTheFile) {
  Hdf5Path parts;
  EXPECT_TRUE(SplitHdf5Path("a:b/c.h5:/d:e", &parts));
  EXPECT_EQ(parts.file, "a:b/c.h5");
  EXPECT_EQ(parts.dataset, "/d:e");
  EXPECT_TRUE(SplitHdf5Path("c.HDF5", &parts));
  EXPECT_EQ(parts.dataset, "");
  EXPECT_FALSE(SplitHdf5Path("c.nrrd", &parts));
  EXPECT_FALSE(SplitHdf5Path("c.nrrd:/a", &parts));
}

TEST_F(Hdf5PathTest, ContentDecidesUnderAnyOtherName) {
  for (const std::string name : {"scan.nxs", "a.mat", "cells.h5ad", "x.cxi", "plain", "v.nrrd"}) {
    const std::string file = Write(name, kSignature + "rest");
    Hdf5Path parts;
    ASSERT_TRUE(SplitHdf5Path(file, &parts)) << name;
    EXPECT_EQ(parts.file, file);
    EXPECT_EQ(parts.dataset, "");
    ASSERT_TRUE(SplitHdf5Path(file + ":/entry/data:x", &parts)) << name;
    EXPECT_EQ(parts.file, file);
    EXPECT_EQ(parts.dataset, "/entry/data:x");
    EXPECT_FALSE(SplitHdf5Path(file + ":", &parts));
  }
}

TEST_F(Hdf5PathTest, NamesOfOtherFormatsInHdf5StayTheirs) {
  Hdf5Path parts;
  for (const std::string name : {"a.nc", "a.nc4", "a.cdf", "a.mnc"}) {
    const std::string file = Write(name, kSignature);
    EXPECT_FALSE(SplitHdf5Path(file, &parts)) << name;
    EXPECT_FALSE(SplitHdf5Path(file + ":u", &parts)) << name;
  }
}

TEST_F(Hdf5PathTest, SignatureStandsBehindAUserBlockOfAPowerOfTwo) {
  for (const std::size_t block : {512U, 1024U, 2048U, 65536U}) {
    EXPECT_TRUE(IsHdf5File(Write("a", std::string(block, 'x') + kSignature))) << block;
  }
  for (const std::size_t block : {1U, 256U, 511U, 1536U}) {
    EXPECT_FALSE(IsHdf5File(Write("a", std::string(block, 'x') + kSignature + "xxxx"))) << block;
  }
  EXPECT_FALSE(IsHdf5File(Write("a", kSignature.substr(0, 7))));
  EXPECT_FALSE(IsHdf5File(Write("a", "")));
  EXPECT_FALSE(IsHdf5File(dir_.Sub("none")));
  EXPECT_FALSE(IsHdf5File(dir_.Sub("")));
}

TEST_F(Hdf5PathTest, NamedPipeIsNotWaitedFor) {
  const std::string pipe = dir_.Sub("pipe");
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  Hdf5Path parts;
  EXPECT_FALSE(SplitHdf5Path(pipe, &parts));
  EXPECT_FALSE(SplitHdf5Path(pipe + ":/a", &parts));
}

}  // namespace
}  // namespace isoscope::source
