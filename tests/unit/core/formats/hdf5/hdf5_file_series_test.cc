#include "core/formats/hdf5/hdf5_file_series.h"

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/open_volume.h"
#include "core/source/volume_series.h"
#include "core/source/volume_source.h"
#include "tests/support/hdf5_mesh_file.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::Hdf5MeshWriter;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::ValuesOf;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr auto kNotFound = absl::StatusCode::kNotFound;

// How a file differs from the others.
struct Difference {
  std::string lacks{};  // a record
  std::vector<hsize_t> dims{2, 3, 4};
  double offset = 10;                      // of x
  double unit = 1;                         // unitSI
  std::vector<double> iterations_after{};  // further iterations, their times
};

class Hdf5FileSeriesTest : public ::testing::Test {
 protected:
  // The vector E and the scalar rho on one grid of 4 x 3 x 2 samples. rho begins with the number of
  // the iteration, E with a thousand times that of its component more.
  void WriteIteration(const std::string& file, int number, double time,
                      const Difference& difference = {}) {
    Hdf5MeshWriter writer(dir_.Sub(file));
    writer.Texts("/", "openPMD", {"1.1.0"});
    writer.Texts("/", "basePath", {"/data/%T/"});
    writer.Texts("/", "meshesPath", {"fields/"});
    writer.Texts("/", "iterationEncoding", {"fileBased"});
    writer.Texts("/", "iterationFormat", {"data%08T.h5"});
    writer.Group("/data");
    WriteGroup(&writer, number, time, difference);
    for (const double further : difference.iterations_after) {
      WriteGroup(&writer, ++number, further, difference);
    }
  }
  static void WriteGroup(Hdf5MeshWriter* writer, int number, double time,
                         const Difference& difference) {
    const std::string iteration = "/data/" + std::to_string(number);
    writer->Group(iteration);
    writer->Numbers(iteration, "time", {time});
    writer->Numbers(iteration, "timeUnitSI", {0.5});
    writer->Group(iteration + "/fields");
    const auto begin = static_cast<float>(number);
    if (difference.lacks != "rho") {
      const std::string rho = iteration + "/fields/rho";
      writer->Ramp(rho, difference.dims, begin);
      Record(writer, rho, difference);
      writer->Numbers(rho, "unitSI", {difference.unit});
    }
    if (difference.lacks != "E") {
      const std::string field = iteration + "/fields/E";
      writer->Group(field);
      Record(writer, field, difference);
      for (const char axis : {'x', 'y', 'z'}) {
        writer->Ramp(field + "/" + axis, difference.dims,
                     begin + static_cast<float>(axis - 'w') * 1000);
      }
    }
  }
  static void Record(Hdf5MeshWriter* writer, const std::string& path,
                     const Difference& difference) {
    writer->Texts(path, "geometry", {"cartesian"});
    writer->Texts(path, "dataOrder", {"C"});
    writer->Texts(path, "axisLabels", {"z", "y", "x"});
    writer->Numbers(path, "gridSpacing", {4, 2, 0.5});
    writer->Numbers(path, "gridUnitSI", {1});
    writer->Numbers(path, "gridGlobalOffset", {30, 20, difference.offset});
  }
  // Iterations 0, 90, 100 and 1000 at 0, 45, 50 and 500 s.
  void WriteFour() {
    for (const int number : {1000, 90, 0, 100}) {
      WriteIteration("data" + Padded(number) + ".h5", number, number);
    }
  }
  static std::string Padded(int number) {
    const std::string digits = std::to_string(number);
    return std::string(8 - digits.size(), '0') + digits;
  }
  testing::TempDir dir_;
};

TEST_F(Hdf5FileSeriesTest, EachPatternOpensAllFilesAsSteps) {
  WriteFour();
  testing::WriteFile(dir_.Sub("data.txt"), "not of the series");
  for (const std::string pattern :
       {"data*.h5", "data????????.h5", "data%08T.h5", "data%T.h5", "data0%T.h5", "data%02T.h5"}) {
    const auto series = OpenVolumeSeries(dir_.Sub(pattern));
    if (pattern == "data%02T.h5") {  // two digits, more only without zeros in front
      EXPECT_THAT(series, StatusIs(kNotFound, HasSubstr("no HDF5 file has such a name")));
      continue;
    }
    ISOSCOPE_ASSERT_OK(series.status()) << pattern;
    EXPECT_THAT((*series)->info().times, ElementsAre(0, 45, 50, 500));
    EXPECT_EQ((*series)->info().time_unit, "s");
    EXPECT_EQ((*series)->info().length_unit, "m");
    EXPECT_EQ((*series)->info().name, dir_.Sub(pattern));
    ASSERT_EQ((*series)->info().fields.size(), 2u);
    EXPECT_EQ((*series)->info().fields[0].name, "E");
    EXPECT_THAT((*series)->info().fields[0].components, ElementsAre("x", "y", "z"));
    for (const auto& [step, number] : {std::pair<int, float>{3, 1000}, {0, 0}, {1, 90}, {2, 100}}) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto e_y, (*series)->Open(0, 1, step));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadAll(*e_y, 1));
      EXPECT_EQ(ValuesOf<float>(bytes)[7], number + 2007);
      EXPECT_EQ(e_y->info().geometry.origin, (math::Vec3d{10, 20, 30}));
      EXPECT_EQ(e_y->info().geometry.spacing, (math::Vec3d{0.5, 2, 4}));
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfVolume(dir_.Sub(pattern)));
    EXPECT_THAT(files, ElementsAre(dir_.Sub("data00000000.h5"), dir_.Sub("data00000090.h5"),
                                   dir_.Sub("data00000100.h5"), dir_.Sub("data00001000.h5")));
  }
}

TEST_F(Hdf5FileSeriesTest, AMarkStandsForDigitsAlone) {
  for (const std::string file :
       {"a9.h5", "a10.h5", "a10_copy.h5", "ab.h5", "a*1.h5", "c[d]7.h5", "cd7.h5"}) {
    WriteIteration(file, 9, 9);
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfHdf5Pattern(dir_.Sub("a%T.h5")));
  ASSERT_TRUE(files.has_value());
  EXPECT_THAT(*files, ElementsAre(dir_.Sub("a9.h5"), dir_.Sub("a10.h5")));
  // Other characters of such a pattern stand for themselves.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto star, FilesOfHdf5Pattern(dir_.Sub("a*%01T.h5")));
  EXPECT_THAT(star.value(), ElementsAre(dir_.Sub("a*1.h5")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto brackets, FilesOfHdf5Pattern(dir_.Sub("c[d]%T.h5")));
  EXPECT_THAT(brackets.value(), ElementsAre(dir_.Sub("c[d]7.h5")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto padded, FilesOfHdf5Pattern(dir_.Sub("a%02T.h5")));
  EXPECT_THAT(padded.value(), ElementsAre(dir_.Sub("a10.h5")));
  for (const std::string name : {"a*1.h5", "no.h5", "a%dT.h5", "a%5T.h5", "a%.h5"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto none, FilesOfHdf5Pattern(dir_.Sub(name)));
    EXPECT_FALSE(none.has_value()) << name;
  }
}

TEST_F(Hdf5FileSeriesTest, OneFileIsItsOwnIteration) {
  WriteFour();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto one, OpenVolumeSeries(dir_.Sub("data00000100.h5")));
  EXPECT_THAT(one->info().times, ElementsAre(50));
  // As does a pattern of one file.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto same, OpenVolumeSeries(dir_.Sub("data*10?.h5:rho")));
  EXPECT_THAT(same->info().times, ElementsAre(50));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenVolumeFile(dir_.Sub("data*10?.h5:rho")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadAll(*volume, 1));
  EXPECT_EQ(ValuesOf<float>(bytes)[7], 107);
  EXPECT_THAT(OpenVolumeFile(dir_.Sub("data%T.h5:rho")),
              StatusIs(kInvalid, AllOf(HasSubstr("data%T.h5"), HasSubstr("4"))));
}

TEST_F(Hdf5FileSeriesTest, AFieldOrAComponentOfAllFiles) {
  WriteFour();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(dir_.Sub("data%T.h5:E:z")));
  ASSERT_EQ(series->info().fields.size(), 1u);
  EXPECT_EQ(series->info().step_count(), 4);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto e_z, series->Open(0, 0, 3));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadAll(*e_z, 1));
  EXPECT_EQ(ValuesOf<float>(bytes)[0], 4000);
  EXPECT_THAT(OpenVolumeSeries(dir_.Sub("data%T.h5:B")),
              StatusIs(kNotFound, AllOf(HasSubstr("data00000000.h5"), HasSubstr("\"B\""))));
  EXPECT_THAT(OpenVolumeSeries(dir_.Sub("data%T.h5:/data/100/fields/rho")),
              StatusIs(kInvalid, HasSubstr("a dataset of a pattern")));
  EXPECT_THAT(OpenVolumeSeries(dir_.Sub("data*.h5:/data/100/fields/rho")),
              StatusIs(kInvalid, HasSubstr("as in '" + dir_.Sub("data*.h5:E") + "', or one file")));
  EXPECT_THAT(OpenVolumeSeries(dir_.Sub("data%T.h5"), {.axes = "ZYX"}),
              StatusIs(kInvalid, HasSubstr("--axes ZYX: a pattern")));
}

TEST_F(Hdf5FileSeriesTest, TheFileThatDiffersIsNamedWithItsValues) {
  struct Case {
    Difference difference;
    double time = 45;
    std::string expected;
  };
  const std::vector<Case> cases{
      {{.lacks = "rho"}, 90, "no field \"rho\" on its grid, but E"},
      {{.dims = {2, 3, 5}}, 90, "5 x 3 x 2 samples"},
      {{.offset = 10.5}, 90, "from (10.5, 20, 30); the first step"},
      {{.unit = 3}, 90, "rho [3]; the first step"},
      {{.iterations_after = {91, 92}}, 90, "3 steps"},
      {{}, 0, "has the time 0, behind 0 of "},
      {{}, -8, "has the time -4, behind 0 of "},
  };
  WriteFour();
  for (const Case& bad : cases) {
    WriteIteration("data00000090.h5", 90, bad.time, bad.difference);
    EXPECT_THAT(OpenVolumeSeries(dir_.Sub("data*.h5")),
                StatusIs(kInvalid, AllOf(HasSubstr("data00000090.h5"), HasSubstr(bad.expected))));
  }
  // More fields than the first has are passed over, also one in front of its own.
  WriteIteration("data00000000.h5", 0, 0, {.lacks = "E"});
  WriteIteration("data00000090.h5", 90, 90);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(dir_.Sub("data*.h5")));
  ASSERT_EQ(series->info().fields.size(), 1u);
  EXPECT_EQ(series->info().fields[0].name, "rho");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto rho, series->Open(0, 0, 1));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadAll(*rho, 1));
  EXPECT_EQ(ValuesOf<float>(bytes)[7], 97);
}

TEST_F(Hdf5FileSeriesTest, ADamagedFileAmongOthersIsNamed) {
  WriteFour();
  const std::string damaged = dir_.Sub("data00000100.h5");
  const auto whole = std::filesystem::file_size(damaged);
  for (const std::uintmax_t size : {whole / 2, whole - 100, std::uintmax_t{0}}) {
    std::filesystem::resize_file(damaged, size);
    const auto series = OpenVolumeSeries(dir_.Sub("data*.h5"));
    EXPECT_FALSE(series.ok()) << size;
    EXPECT_THAT(series.status().message(), HasSubstr("data00000100.h5"));
  }
  testing::WriteFile(damaged, "text");
  EXPECT_THAT(OpenVolumeSeries(dir_.Sub("data*.h5")).status().message(),
              HasSubstr("data00000100.h5"));
}

TEST_F(Hdf5FileSeriesTest, AFileThatChangesLaterIsRefused) {
  WriteFour();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(dir_.Sub("data*.h5")));
  WriteIteration("data00000100.h5", 100, 100, {.offset = 12});
  EXPECT_THAT(series->Open(1, 0, 2),
              StatusIs(kInvalid, AllOf(HasSubstr("data00000100.h5:/data/100/fields/rho: step 2"),
                                       HasSubstr("from (12, 20, 30)"))));
  std::filesystem::remove(dir_.Sub("data00000100.h5"));
  EXPECT_THAT(series->Open(1, 0, 2), StatusIs(kNotFound, HasSubstr("data00000100.h5")));
}

TEST_F(Hdf5FileSeriesTest, FilesWithoutMeshesAreRefused) {
  for (const std::string file : {"a1.h5", "a2.h5"}) {
    Hdf5MeshWriter writer(dir_.Sub(file));
    writer.Ramp("/u", {2, 3, 4});
  }
  EXPECT_THAT(OpenVolumeSeries(dir_.Sub("a*.h5")),
              StatusIs(kInvalid, AllOf(HasSubstr("a1.h5"), HasSubstr("not describe its meshes"))));
}

}  // namespace
}  // namespace isoscope::source
