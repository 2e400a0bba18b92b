#include "core/source/hdf5/hdf5_filters.h"

#include <cstdlib>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/source/hdf5/hdf5_handle.h"
#include "hdf5.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

class Hdf5FiltersTest : public ::testing::Test {
 protected:
  Hdf5FiltersTest() { H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr); }
  // A dataset with these filters; those of others may be missing.
  Hdf5Handle Dataset(const std::vector<H5Z_filter_t>& filters) {
    const hsize_t dims[] = {4, 5, 6};
    const Hdf5Handle space(H5Screate_simple(3, dims, nullptr), H5Sclose);
    const Hdf5Handle properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
    H5Pset_chunk(properties.get(), 3, dims);
    const unsigned int level = 4;
    for (const H5Z_filter_t id : filters) {
      H5Pset_filter(properties.get(), id, H5Z_FLAG_OPTIONAL, id == H5Z_FILTER_DEFLATE ? 1 : 0,
                    &level);
    }
    const std::string name = "v" + std::to_string(count_++);
    return {H5Dcreate2(file_.get(), name.c_str(), H5T_STD_U8LE, space.get(), H5P_DEFAULT,
                       properties.get(), H5P_DEFAULT),
            H5Dclose};
  }
  const TempDir dir_;
  const Hdf5Handle file_{
      H5Fcreate(dir_.Sub("a.h5").c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT), H5Fclose};
  int count_ = 0;
};

TEST_F(Hdf5FiltersTest, FiltersOfTheLibraryAreThere) {
  const Hdf5Handle dataset =
      Dataset({H5Z_FILTER_SHUFFLE, H5Z_FILTER_DEFLATE, H5Z_FILTER_FLETCHER32});
  ISOSCOPE_EXPECT_OK(CheckHdf5Filters(dataset.get()));
  EXPECT_EQ(DescribeHdf5Filters(dataset.get()), "gzip");
  EXPECT_EQ(DescribeHdf5Filters(Dataset({}).get()), "");
}

TEST_F(Hdf5FiltersTest, MissingOneIsNamedWithItsNumberItsNameAndWhatToDo) {
  // Whatever plugins this machine has: the library would load each, and some leak as they go.
  unsigned int folders = 0;
  while (H5PLsize(&folders) >= 0 && folders > 0) {
    ASSERT_GE(H5PLremove(folders - 1), 0);
  }
  const Hdf5Handle known = Dataset({32026});
  EXPECT_THAT(CheckHdf5Filters(known.get()),
              StatusIs(kInvalid, AllOf(HasSubstr("filter 32026 (Blosc2), which is not installed"),
                                       HasSubstr("Debian has no package of it"),
                                       HasSubstr("h5repack -f GZIP=4 IN OUT"))));
  EXPECT_EQ(DescribeHdf5Filters(known.get()), "Blosc2 (not installed)");
  EXPECT_THAT(CheckHdf5Filters(Dataset({H5Z_FILTER_DEFLATE, 31999}).get()),
              StatusIs(kInvalid, HasSubstr("filter 31999, which is not installed")));
}

TEST_F(Hdf5FiltersTest, PackagesOfDebianAreNamed) {
  for (const auto& [id, text] :
       {std::pair{307U,
                  "filter 307 (bzip2), which is not installed: install Debian's package "
                  "hdf5-filter-plugin"},
        std::pair{32000U,
                  "(LZF), which is not installed: install Debian's package hdf5-plugin-lzf"},
        std::pair{32001U,
                  "(Blosc), which is not installed: install Debian's package "
                  "hdf5-filter-plugin-blosc-serial"},
        std::pair{32004U,
                  "(LZ4), which is not installed: install Debian's package "
                  "hdf5-filter-plugin"},
        std::pair{32013U,
                  "(ZFP), which is not installed: install Debian's package "
                  "hdf5-filter-plugin-zfp-serial"}}) {
    EXPECT_THAT(MissingHdf5Filter(id),
                StatusIs(kInvalid, AllOf(HasSubstr(text), Not(HasSubstr("h5repack")))));
  }
}

// A plugin is code: a folder that others may write to must not be looked at.
TEST(Hdf5PluginFoldersTest, OnlyThatOfTheSystemAndThoseThatTheUserNamesForIsoscope) {
  setenv("HDF5_PLUGIN_PATH", "/tmp:.", 1);
  setenv("ISOSCOPE_HDF5_PLUGIN_PATH", "relative:/own/plugins::/more", 1);
  PrepareHdf5Filters();
  PrepareHdf5Filters();
  unsigned int count = 0;
  ASSERT_GE(H5PLsize(&count), 0);
  std::string folders;
  for (unsigned int i = 0; i < count; ++i) {
    char folder[256] = "";
    H5PLget(i, folder, sizeof(folder));
    folders += std::string(folder) + ";";
  }
  EXPECT_EQ(folders, std::string(H5_DEFAULT_PLUGINDIR) + ";/own/plugins;/more;");
}

}  // namespace
}  // namespace isoscope::source
