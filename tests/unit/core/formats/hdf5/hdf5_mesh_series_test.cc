#include "core/formats/hdf5/hdf5_mesh_series.h"

#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
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

class Hdf5MeshSeriesTest : public ::testing::Test {
 protected:
  // An image of 4 x 3 x 2 points, with steps if there are times.
  void WriteImage(const std::string& path, const std::vector<double>& times,
                  const std::string& type = "ImageData", float begin = 0) {
    Hdf5MeshWriter writer(path);
    writer.Group("/VTKHDF");
    writer.Texts("/VTKHDF", "Type", {type});
    writer.Numbers("/VTKHDF", "WholeExtent", {1, 4, 0, 2, 0, 1});
    writer.Numbers("/VTKHDF", "Origin", {10, 20, 30});
    writer.Numbers("/VTKHDF", "Spacing", {0.5, 2, 4});
    writer.Numbers("/VTKHDF", "Direction", {0, -1, 0, 1, 0, 0, 0, 0, 1});
    writer.Group("/VTKHDF/PointData");
    writer.Group("/VTKHDF/CellData");
    if (times.empty()) {
      writer.Ramp("/VTKHDF/PointData/p", {2, 3, 4}, begin);
      writer.Ramp("/VTKHDF/PointData/v", {2, 3, 4, 3});
      return;
    }
    writer.Ramp("/VTKHDF/PointData/p", {times.size(), 2, 3, 4}, begin);
    writer.Ramp("/VTKHDF/PointData/v", {times.size(), 2, 3, 4, 3});
    writer.Group("/VTKHDF/Steps");
    writer.Numbers("/VTKHDF/Steps", "NSteps", {static_cast<double>(times.size())});
    testing::WriteHdf5Dataset(writer.file(), "/VTKHDF/Steps/Values", {times.size()},
                              H5T_NATIVE_DOUBLE, times.data());
    writer.Group("/VTKHDF/Steps/PointDataOffsets");
    const std::vector<int> offsets(times.size(), times.size() > 1 ? 1 : 0);
    testing::WriteHdf5Dataset(writer.file(), "/VTKHDF/Steps/PointDataOffsets/v", {times.size()},
                              H5T_NATIVE_INT, offsets.data());
  }
  // Iterations 5 and 10 with E, staggered or not, and rho on the grid's nodes.
  void WriteOpenPmd(const std::string& path, bool is_staggered, const std::string& order = "C") {
    Hdf5MeshWriter writer(path);
    writer.Texts("/", "openPMD", {"1.1.0"});
    writer.Texts("/", "basePath", {"/data/%T/"});
    writer.Texts("/", "meshesPath", {"fields/"});
    writer.Group("/data");
    for (const std::string iteration : {"/data/10", "/data/5"}) {
      writer.Group(iteration);
      writer.Numbers(iteration, "time", {iteration == "/data/5" ? 2.0 : 4.0});
      writer.Numbers(iteration, "timeUnitSI", {0.5});
      writer.Group(iteration + "/fields");
      const float begin = iteration == "/data/5" ? 0 : 100;
      const std::string rho = iteration + "/fields/rho";
      writer.Ramp(rho, {2, 3, 4}, begin);
      Record(&writer, rho, order);
      writer.Numbers(rho, "position", {0, 0, 0});
      writer.Numbers(rho, "unitSI", {2});
      const std::string field = iteration + "/fields/E";
      writer.Group(field);
      Record(&writer, field, order);
      for (const char axis : {'x', 'y', 'z'}) {
        const std::string component = field + "/" + axis;
        writer.Ramp(component, {2, 3, 4}, begin + static_cast<float>(axis - 'w') * 1000);
        std::vector<double> position(3, 0.5);
        if (is_staggered) {
          position[static_cast<std::size_t>('z' - axis)] = 0;
        }
        writer.Numbers(component, "position", position);
        writer.Numbers(component, "unitSI", {1});
      }
    }
  }
  static void Record(Hdf5MeshWriter* writer, const std::string& path, const std::string& order) {
    writer->Texts(path, "geometry", {"cartesian"});
    writer->Texts(path, "dataOrder", {order});
    const bool is_c = order == "C";
    writer->Texts(
        path, "axisLabels",
        is_c ? std::vector<std::string>{"z", "y", "x"} : std::vector<std::string>{"x", "y", "z"});
    writer->Numbers(path, "gridSpacing",
                    is_c ? std::vector<double>{4, 2, 0.5} : std::vector<double>{0.5, 2, 4});
    writer->Numbers(path, "gridGlobalOffset",
                    is_c ? std::vector<double>{30, 20, 10} : std::vector<double>{10, 20, 30});
    writer->Numbers(path, "gridUnitSI", {2});
    writer->Numbers(path, "unitDimension", {1, 1, -3, -1, 0, 0, 0});
  }
  testing::TempDir dir_;
};

math::Vec3d At(const VolumeSource& volume, const math::Vec3d& index) {
  return math::TransformPoint(volume.info().geometry.world_from_index(), index);
}

TEST_F(Hdf5MeshSeriesTest, ArraysOfVtkHdfWithAndWithoutSteps) {
  for (const std::vector<double>& times : {std::vector<double>{}, std::vector<double>{0.5, 2}}) {
    const std::string path = dir_.Sub(times.empty() ? "a.vtkhdf" : "a.h5");
    WriteImage(path, times);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path));
    EXPECT_EQ(series->info().times, times);
    ASSERT_EQ(series->info().fields.size(), 2u);
    EXPECT_EQ(series->info().fields[0].name, "p");
    EXPECT_THAT(series->info().fields[1].components, ElementsAre("x", "y", "z"));
    for (int step = 0; step < series->info().step_count(); ++step) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto p, series->Open(0, 0, step));
      // Index x runs along world y, index y against world x.
      EXPECT_EQ(At(*p, {0, 0, 0}), (math::Vec3d{10, 20.5, 30}));
      EXPECT_EQ(At(*p, {3, 2, 1}), (math::Vec3d{6, 22, 34}));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*p, 1));
      EXPECT_EQ(ValuesOf<float>(read)[7], static_cast<float>(24 * step + 7));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto v_y, series->Open(1, 1, step));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string vectors, ReadAll(*v_y, 2));
      const int offset = times.empty() ? 0 : 1;  // as PointDataOffsets has it
      EXPECT_EQ(ValuesOf<float>(vectors)[7], static_cast<float>(72 * offset + 3 * 7 + 1));
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto part, OpenVolumeSeries(path + ":v:z"));
    EXPECT_EQ(part->info().fields[0].name, "v");
    EXPECT_EQ(part->info().step_count(), series->info().step_count());
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfVolume(path));
    EXPECT_THAT(files, ElementsAre(path));
    EXPECT_THAT(OpenVolumeFile(path), StatusIs(kInvalid, HasSubstr("p, v (x, y, z)")));
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto one, OpenVolumeFile(dir_.Sub("a.vtkhdf:p")));
  EXPECT_EQ(At(*one, {3, 2, 1}), (math::Vec3d{6, 22, 34}));
  // A dataset by its name is as in any HDF5 file.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto raw,
                                OpenVolumeFile(dir_.Sub("a.vtkhdf:/VTKHDF/PointData/p")));
  EXPECT_EQ(At(*raw, {0, 0, 0}), (math::Vec3d{0, 0, 0}));
}

// Other shapes were passed over, and each step was its own number.
TEST_F(Hdf5MeshSeriesTest, OffsetsOfVtkHdfAreOneAStepOrRefused) {
  const std::vector<double> times{0, 1, 2};
  const std::vector<int> offsets{2, 1, 0, 0, 1, 2};
  int files = 0;
  const auto write = [&](const std::vector<hsize_t>& dims) {
    const std::string path = dir_.Sub(absl::StrCat("o", files++, ".vtkhdf"));
    Hdf5MeshWriter writer(path);
    for (const char* group : {"/VTKHDF", "/VTKHDF/PointData", "/VTKHDF/Steps"}) {
      writer.Group(group);
    }
    writer.Texts("/VTKHDF", "Type", {"ImageData"});
    writer.Numbers("/VTKHDF", "WholeExtent", {0, 3, 0, 2, 0, 1});
    writer.Ramp("/VTKHDF/PointData/p", {3, 2, 3, 4});
    writer.Numbers("/VTKHDF/Steps", "NSteps", {3});
    testing::WriteHdf5Dataset(writer.file(), "/VTKHDF/Steps/Values", {3}, H5T_NATIVE_DOUBLE,
                              times.data());
    if (!dims.empty()) {
      writer.Group("/VTKHDF/Steps/PointDataOffsets");
      testing::WriteHdf5Dataset(writer.file(), "/VTKHDF/Steps/PointDataOffsets/p", dims,
                                H5T_NATIVE_INT, offsets.data());
    }
    return path;
  };
  for (const std::vector<hsize_t>& dims :
       {std::vector<hsize_t>{3}, std::vector<hsize_t>{3, 1}, std::vector<hsize_t>{}}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(write(dims)));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto p, series->Open(0, 0, 0));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*p, 1));
    EXPECT_EQ(ValuesOf<float>(read)[0], dims.empty() ? 0 : 48) << dims.size();
  }
  for (const auto& [dims, words] : {std::pair(std::vector<hsize_t>{2}, "has 2 numbers"),
                                    std::pair(std::vector<hsize_t>{1, 3}, "has 1 x 3 numbers"),
                                    std::pair(std::vector<hsize_t>{3, 2}, "has 3 x 2 numbers")}) {
    EXPECT_THAT(OpenVolumeSeries(write(dims)),
                StatusIs(kInvalid, AllOf(HasSubstr("Steps/PointDataOffsets/p"), HasSubstr(words),
                                         HasSubstr("expected one a step, 3"))));
  }
}

TEST_F(Hdf5MeshSeriesTest, FilesOfVtkHdfAreStepsByAPattern) {
  WriteImage(dir_.Sub("a9.vtkhdf"), {});
  WriteImage(dir_.Sub("a10.vtkhdf"), {}, "ImageData", 100);
  WriteImage(dir_.Sub("b9.h5"), {2.5});
  WriteImage(dir_.Sub("b10.h5"), {4}, "ImageData", 100);
  struct Case {
    std::string pattern;
    std::vector<double> times;
  };
  for (const Case& c : {Case{"a*.vtkhdf", {0, 1}}, Case{"b%T.h5", {2.5, 4}}}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(dir_.Sub(c.pattern)));
    EXPECT_EQ(series->info().times, c.times);
    ASSERT_EQ(series->info().fields.size(), 2u);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto p, series->Open(0, 0, 1));
    EXPECT_EQ(At(*p, {3, 2, 1}), (math::Vec3d{6, 22, 34}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*p, 1));
    EXPECT_EQ(ValuesOf<float>(read)[7], 107);
  }
  // A file alone has no time, as without a pattern.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto one, OpenVolumeSeries(dir_.Sub("a9*.vtkhdf")));
  EXPECT_TRUE(one->info().times.empty());
  WriteImage(dir_.Sub("b10.h5"), {4, 5});
  EXPECT_THAT(OpenVolumeSeries(dir_.Sub("b*.h5")),
              StatusIs(kInvalid, AllOf(HasSubstr("b10.h5"), HasSubstr("2 steps"))));
}

TEST_F(Hdf5MeshSeriesTest, RecordsOfOpenPmd) {
  for (const std::string order : {"C", "F"}) {
    WriteOpenPmd(dir_.Sub("a.h5"), false, order);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(dir_.Sub("a.h5")));
    EXPECT_THAT(series->info().times, ElementsAre(1, 2));
    EXPECT_EQ(series->info().time_unit, "s");
    EXPECT_EQ(series->info().length_unit, "m");
    ASSERT_EQ(series->info().fields.size(), 1u);
    EXPECT_EQ(series->info().fields[0].name, "E");
    EXPECT_EQ(series->info().fields[0].unit, "m kg s^-3 A^-1");
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto e_y, series->Open(0, 1, 1));
    EXPECT_EQ(At(*e_y, {0, 0, 0}), (math::Vec3d{2 * 10.25, 2 * 21, 2 * 32}));
    EXPECT_EQ(At(*e_y, {3, 2, 1}), (math::Vec3d{2 * 11.75, 2 * 25, 2 * 36}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*e_y, 1));
    EXPECT_EQ(ValuesOf<float>(read)[7], 2107);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto rho, OpenVolumeSeries(dir_.Sub("a.h5:rho")));
    EXPECT_EQ(rho->info().fields[0].unit, "2 m kg s^-3 A^-1");
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto first, rho->Open(0, 0, 0));
    EXPECT_EQ(At(*first, {0, 0, 0}), (math::Vec3d{20, 40, 60}));
  }
}

TEST_F(Hdf5MeshSeriesTest, StaggeredComponentsAreFieldsOfTheirOwn) {
  WriteOpenPmd(dir_.Sub("a.h5"), true);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto x, OpenVolumeSeries(dir_.Sub("a.h5:E/x")));
  EXPECT_EQ(x->info().fields[0].name, "E/x");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, x->Open(0, 0, 0));
  EXPECT_EQ(At(*volume, {0, 0, 0}), (math::Vec3d{20, 42, 64}));
}

// A scalar record and a component that are groups, in place of datasets.
TEST_F(Hdf5MeshSeriesTest, ConstantComponentsOfOpenPmdAreVolumes) {
  const std::string path = dir_.Sub("a.h5");
  const auto write = [&](const std::vector<double>& shape, bool is_single = false) {
    Hdf5MeshWriter writer(path);
    writer.Texts("/", "openPMD", {"1.1.0"});
    writer.Texts("/", "meshesPath", {"fields/"});
    for (const char* group : {"/data", "/data/5", "/data/5/fields", "/data/5/fields/rho",
                              "/data/5/fields/B", "/data/5/fields/B/x"}) {
      writer.Group(group);
    }
    writer.Ramp("/data/5/fields/B/y", {2, 3, 4});
    for (const char* record : {"/data/5/fields/rho", "/data/5/fields/B"}) {
      Record(&writer, record, "C");
    }
    for (const char* constant : {"/data/5/fields/rho", "/data/5/fields/B/x"}) {
      if (is_single) {
        writer.Float(constant, "value", -0.1F);
      } else {
        writer.Numbers(constant, "value", {-0.1});
      }
      writer.Numbers(constant, "shape", shape);
    }
  };
  write({2, 3, 4});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path));
  ASSERT_EQ(series->info().fields.size(), 2u);
  EXPECT_THAT(series->info().fields[0].components, ElementsAre("x", "y"));
  EXPECT_EQ(series->info().fields[1].name, "rho");
  for (const int field : {0, 1}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(field, 0, 0));
    EXPECT_EQ(volume->info().type, volume::ScalarType::kFloat64);
    EXPECT_EQ(At(*volume, {3, 2, 1}), (math::Vec3d{2 * 11.5, 2 * 24, 2 * 34}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadAll(*volume, 1));
    EXPECT_EQ(ValuesOf<double>(bytes), std::vector<double>(24, -0.1));
  }
  write({2, 3, 4}, true);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto single, OpenVolumeFile(path + ":rho"));
  EXPECT_EQ(single->info().type, volume::ScalarType::kFloat32);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string floats, ReadAll(*single, 1));
  EXPECT_EQ(ValuesOf<float>(floats), std::vector<float>(24, -0.1F));
  // Shapes that are none leave the components out.
  for (const std::vector<double>& shape :
       {std::vector<double>{2, 3}, {2, 3, 0}, {2, 3, -4}, {2, 3, 1e300}, {2, 3, 4, 5}}) {
    write(shape);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto others, OpenVolumeSeries(path));
    ASSERT_EQ(others->info().fields.size(), 1u);
    EXPECT_EQ(others->info().fields[0].name, "B/y");
  }
  // A grid that is too large for any volume.
  write({1e9, 1e9, 1e9});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto huge, OpenVolumeSeries(path + ":rho"));
  EXPECT_THAT(huge->Open(0, 0, 0), StatusIs(kInvalid, HasSubstr("fields/rho: ")));
}

TEST_F(Hdf5MeshSeriesTest, GridsOfOpenPmdAreWholeAndMayRunBackwards) {
  std::string path;  // another one each time, since a file that is open can't be written
  int files = 0;
  // Leaves out the attribute `without`.
  const auto write = [&](const std::vector<double>& spacing, const std::string& without = "",
                         const std::vector<double>& position = {0, 0, 0}) {
    path = dir_.Sub(absl::StrCat("g", files++, ".h5"));
    Hdf5MeshWriter writer(path);
    writer.Texts("/", "openPMD", {"1.1.0"});
    for (const char* group : {"/data", "/data/5", "/data/5/meshes"}) {
      writer.Group(group);
    }
    const std::string rho = "/data/5/meshes/rho";
    writer.Ramp(rho, {2, 3, 4});
    writer.Texts(rho, "axisLabels", {"z", "y", "x"});
    const auto put = [&](const std::string& name, const std::vector<double>& numbers) {
      if (name != without) {
        writer.Numbers(name.rfind("time", 0) == 0 ? "/data/5" : rho, name, numbers);
      }
    };
    put("gridSpacing", spacing);
    put("gridGlobalOffset", {30, 20, 10});
    put("position", position);
    put("gridUnitSI", {2});
    put("time", {7});
    put("timeUnitSI", {0.5});
  };
  write({4, -2, 0.5});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto series, OpenVolumeSeries(path));
  EXPECT_THAT(series->info().times, ElementsAre(3.5));
  EXPECT_EQ(series->info().time_unit, "s");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(0, 0, 0));
  EXPECT_EQ(At(*volume, {0, 0, 0}), (math::Vec3d{20, 40, 60}));
  EXPECT_EQ(At(*volume, {3, 2, 1}), (math::Vec3d{23, 32, 68}));
  for (const char* without : {"time", "timeUnitSI"}) {
    write({4, 2, 0.5}, without);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(series, OpenVolumeSeries(path));
    EXPECT_THAT(series->info().times, ElementsAre(5));
    EXPECT_EQ(series->info().time_unit, "");
  }
  for (const char* without : {"gridSpacing", "gridUnitSI"}) {
    write({4, 2, 0.5}, without);
    EXPECT_THAT(OpenVolumeSeries(path),
                StatusIs(kInvalid, AllOf(HasSubstr("rho has 0 numbers"), HasSubstr(without))));
  }
  write({4, 2, 0});
  EXPECT_THAT(OpenVolumeSeries(path), StatusIs(kInvalid, HasSubstr("rho has gridSpacing 0")));
  write({4, 2, std::nan("")});
  EXPECT_THAT(OpenVolumeSeries(path), StatusIs(kInvalid, HasSubstr("rho has nan in gridSpacing")));
  write({4, 2, 0.5}, "", {0.5, 0.5});
  EXPECT_THAT(OpenVolumeSeries(path), StatusIs(kInvalid, HasSubstr("2 numbers in position")));
}

// A window that moves, or another unit of values, made all steps those of the first one's grid.
TEST_F(Hdf5MeshSeriesTest, IterationsOfOpenPmdThatDifferAreNamedWithBothValues) {
  int files = 0;
  // Iterations 0 and 100 of rho and v; the second one of rho has those in place of its own.
  const auto write = [&](const std::string& changed, const std::vector<double>& numbers,
                         const std::vector<std::string>& texts = {}) {
    const std::string path = dir_.Sub(absl::StrCat("a ", files++, ".h5"));
    Hdf5MeshWriter writer(path);
    writer.Texts("/", "openPMD", {"1.1.0"});
    writer.Group("/data");
    for (const std::string iteration : {"/data/0", "/data/100"}) {
      writer.Group(iteration);
      writer.Group(iteration + "/meshes");
      for (const std::string name : {"rho", "v"}) {
        const std::string record = iteration + "/meshes/" + name;
        const bool is_other = name == "rho" && iteration == "/data/100";
        writer.Ramp(record, {2, 3, 4});
        const auto put = [&](const std::string& attribute, const std::vector<double>& own) {
          if (is_other && attribute == changed && numbers.empty()) {
            return;  // left out
          }
          writer.Numbers(record, attribute, is_other && attribute == changed ? numbers : own);
        };
        const auto put_texts = [&](const std::string& attribute,
                                   const std::vector<std::string>& own) {
          writer.Texts(record, attribute, is_other && attribute == changed ? texts : own);
        };
        put_texts("geometry", {"cartesian"});
        put_texts("axisLabels", {"z", "y", "x"});
        put("gridSpacing", {4, 2, 0.5});
        put("gridGlobalOffset", {0, 0, 0});
        put("gridUnitSI", {1});
        put("position", {0, 0, 0});
        put("unitSI", {1});
        put("unitDimension", {0, 0, 0, 0, 0, 0, 0});
      }
    }
    return path;
  };
  struct Case {
    std::string changed;
    std::vector<double> numbers;
    std::vector<std::string> texts;
    std::string words;
  };
  for (const Case& c :
       {Case{"gridGlobalOffset", {100, 0, 0}, {}, "100 0 0, but /data/0/meshes/rho of 0 0 0"},
        {"gridSpacing", {4, 2, 0.25}, {}, "4 2 0.25, but /data/0/meshes/rho of 4 2 0.5"},
        {"gridSpacing", {4, 2, 0.5 + 0x1p-30}, {}, "4 2 0.50000000093132257, but"},
        {"gridUnitSI", {1e-3}, {}, "0.001 0.001 0.001, but /data/0/meshes/rho of 1 1 1"},
        {"gridUnitSI", {}, {}, "nothing, but /data/0/meshes/rho of 1 1 1"},
        {"position", {0, 0.5, 0}, {}, "0 0.5 0, but /data/0/meshes/rho of 0 0 0"},
        {"unitSI", {1000}, {}, "1000, but /data/0/meshes/rho of 1"},
        {"unitDimension", {1, 0, 0, 0, 0, 0, 0}, {}, "1 0 0 0 0 0 0, but"},
        {"axisLabels", {}, {"x", "y", "z"}, "x y z, but /data/0/meshes/rho of z y x"},
        {"geometry", {}, {"cylindrical"}, "cylindrical, but /data/0/meshes/rho of cartesian"}}) {
    SCOPED_TRACE(c.changed);
    const std::string path = write(c.changed, c.numbers, c.texts);
    for (const std::string part : {"", ":rho"}) {
      EXPECT_THAT(OpenVolumeSeries(path + part),
                  StatusIs(kInvalid, AllOf(HasSubstr(path + ": /data/100/meshes/rho has " +
                                                     c.changed + " of " + c.words),
                                           HasSubstr("'" + path + ":/data/100/meshes/rho'"))));
    }
    // The other record is the same in both.
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto other, OpenVolumeSeries(path + ":v"));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, other->Open(0, 0, 1));
    EXPECT_EQ(volume->info().geometry.spacing, (math::Vec3d{0.5, 2, 4}));
  }
  // What is missing is the default; one number stands for three.
  for (const std::string changed : {"position", "gridGlobalOffset", "unitSI", "unitDimension"}) {
    ISOSCOPE_EXPECT_OK(OpenVolumeSeries(write(changed, {})).status());
  }
  ISOSCOPE_EXPECT_OK(OpenVolumeSeries(write("gridUnitSI", {1, 1, 1})).status());
}

TEST_F(Hdf5MeshSeriesTest, RefusesInASentence) {
  WriteImage(dir_.Sub("a.h5"), {}, "UnstructuredGrid");
  EXPECT_THAT(OpenVolumeSeries(dir_.Sub("a.h5")),
              StatusIs(kInvalid, AllOf(HasSubstr("a.h5"), HasSubstr("\"UnstructuredGrid\""))));
  WriteImage(dir_.Sub("a.h5"), {2, 1});
  EXPECT_THAT(OpenVolumeSeries(dir_.Sub("a.h5")), StatusIs(kInvalid, HasSubstr("ascend")));
  {
    Hdf5MeshWriter writer(dir_.Sub("b.h5"));
    writer.Group("/VTKHDF");
    writer.Texts("/VTKHDF", "Type", {"ImageData"});
    writer.Numbers("/VTKHDF", "WholeExtent", {0, 9, 0, 2, 0, 1});
    writer.Group("/VTKHDF/PointData");
    writer.Ramp("/VTKHDF/PointData/p", {2, 3, 4});
  }
  EXPECT_THAT(OpenVolumeSeries(dir_.Sub("b.h5")),
              StatusIs(kInvalid, AllOf(HasSubstr("2 x 3 x 4"), HasSubstr("2 x 3 x 10"))));
  {
    Hdf5MeshWriter writer(dir_.Sub("c.h5"));
    writer.Texts("/", "openPMD", {"1.1.0"});
    writer.Group("/data");
  }
  EXPECT_THAT(OpenVolumeSeries(dir_.Sub("c.h5")), StatusIs(kInvalid, HasSubstr("0 iterations")));
  {
    Hdf5MeshWriter writer(dir_.Sub("theta.h5"));
    writer.Texts("/", "openPMD", {"1.1.0"});
    for (const char* group : {"/data", "/data/5", "/data/5/meshes"}) {
      writer.Group(group);
    }
    writer.Ramp("/data/5/meshes/rho", {3, 4, 5});
    writer.Texts("/data/5/meshes/rho", "geometry", {"thetaMode"});
  }
  EXPECT_THAT(OpenVolumeSeries(dir_.Sub("theta.h5")),
              StatusIs(kInvalid, HasSubstr("rho has the geometry \"thetaMode\"")));
  testing::WriteFile(dir_.Sub("d.h5"), "text");
  EXPECT_THAT(OpenHdf5MeshSeries(dir_.Sub("d.h5"), ""),
              StatusIs(kInvalid, HasSubstr("no HDF5 file")));
}

// An Imaris file of 3 x 2 x 2 samples, in datasets of 4 x 4 x 2, by step and channel.
void WriteImaris(const std::string& path, int steps, const std::string& second_time,
                 const std::string& samples_along_x = "3", float begin = 0) {
  Hdf5MeshWriter writer(path);
  writer.Characters("/", "ImarisVersion", "5.5.0");
  for (const char* group :
       {"/DataSetInfo", "/DataSetInfo/Image", "/DataSetInfo/Channel 0", "/DataSetInfo/Channel 1",
        "/DataSetInfo/TimeInfo", "/DataSet", "/DataSet/ResolutionLevel 0"}) {
    writer.Group(group);
  }
  const char* const image = "/DataSetInfo/Image";
  writer.Characters(image, "X", samples_along_x);
  writer.Characters(image, "Y", "2");
  writer.Characters(image, "Z", "2");
  writer.Characters(image, "Unit", "um");
  const std::vector<std::string> begins{"10", "-1.5", "0"};
  const std::vector<std::string> ends{"11.5", "0.5", "8"};
  for (int axis = 0; axis < 3; ++axis) {
    const auto at = static_cast<std::size_t>(axis);
    writer.Characters(image, "ExtMin" + std::to_string(axis), begins[at]);
    writer.Characters(image, "ExtMax" + std::to_string(axis), ends[at]);
  }
  writer.Characters("/DataSetInfo/Channel 0", "Name", "DAPI");
  writer.Characters("/DataSetInfo/Channel 1", "Name", "(name not specified)");
  writer.Characters("/DataSetInfo/TimeInfo", "TimePoint1", "2020-06-22 10:00:00.250");
  writer.Characters("/DataSetInfo/TimeInfo", "TimePoint2", second_time);
  for (int step = 0; step < steps; ++step) {
    const std::string point = "/DataSet/ResolutionLevel 0/TimePoint " + std::to_string(step);
    writer.Group(point);
    for (int channel = 0; channel < 2; ++channel) {
      const std::string group = point + "/Channel " + std::to_string(channel);
      writer.Group(group);
      writer.Ramp(group + "/Data", {2, 4, 4},
                  begin + static_cast<float>(1000 * step + 100 * channel));
    }
  }
}

TEST_F(Hdf5MeshSeriesTest, ChannelsOfImarisAreFieldsOnTheGridOfItsBorders) {
  const std::string path = dir_.Sub("a.ims");
  WriteImaris(path, 2, "2020-06-22 10:00:02.750");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path));
  ASSERT_EQ(series->info().fields.size(), 2u);
  EXPECT_EQ(series->info().fields[0].name, "DAPI");
  EXPECT_EQ(series->info().fields[1].name, "channel 1");
  EXPECT_THAT(series->info().times, ElementsAre(0, 2.5));
  EXPECT_EQ(series->info().time_unit, "s");
  EXPECT_EQ(series->info().length_unit, "um");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, series->Open(1, 0, 1));
  const volume::GridGeometry& grid = source->info().geometry;
  EXPECT_EQ(grid.sample_dims, (math::Index3{3, 2, 2}));
  EXPECT_EQ(grid.spacing, (math::Vec3d{0.5, 1, 4}));
  EXPECT_EQ(grid.origin, (math::Vec3d{10.25, -1, 2}));  // the middle of the first voxel
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadAll(*source, 2));
  // Without the samples that fill the dataset up.
  EXPECT_THAT(ValuesOf<float>(bytes),
              ElementsAre(1100, 1101, 1102, 1104, 1105, 1106, 1116, 1117, 1118, 1120, 1121, 1122));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto part, OpenVolumeSeries(path + ":DAPI"));
  EXPECT_EQ(part->info().fields.size(), 1u);
}

TEST_F(Hdf5MeshSeriesTest, FilesOfImarisAreStepsByAPattern) {
  WriteImaris(dir_.Sub("a9.ims"), 1, "");
  WriteImaris(dir_.Sub("a10.ims"), 1, "", "3", 5000);
  {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(dir_.Sub("a*.ims")));
    EXPECT_THAT(series->info().times, ElementsAre(0, 1));
    EXPECT_EQ(series->info().length_unit, "um");
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, series->Open(1, 0, 1));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadAll(*source, 2));
    EXPECT_EQ(ValuesOf<float>(bytes)[3], 5104);
    EXPECT_EQ(source->info().geometry.origin, (math::Vec3d{10.25, -1, 2}));
  }
  WriteImaris(dir_.Sub("a10.ims"), 1, "", "2");
  EXPECT_THAT(OpenVolumeSeries(dir_.Sub("a*.ims")),
              StatusIs(kInvalid, AllOf(HasSubstr("a10.ims"), HasSubstr("2 x 2 x 2 samples"))));
}

TEST_F(Hdf5MeshSeriesTest, ImarisTimesThatDoNotAscendAreNumbers) {
  const std::string path = dir_.Sub("a.ims");
  for (const char* time : {"2020-06-22 09:00:00", "soon"}) {
    WriteImaris(path, 2, time);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path));
    EXPECT_THAT(series->info().times, ElementsAre(0, 1));
    EXPECT_EQ(series->info().time_unit, "");
  }
}

TEST_F(Hdf5MeshSeriesTest, ImarisSizesThatMakeNoSenseAreRefused) {
  const std::string path = dir_.Sub("a.ims");
  for (const char* size : {"0", "-3", "many"}) {
    WriteImaris(path, 1, "x", size);
    EXPECT_THAT(OpenVolumeSeries(path).status(),
                StatusIs(kInvalid, HasSubstr(std::string("is \"") + size)));
  }
  WriteImaris(path, 1, "x", "5");  // more than the dataset has
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto larger, OpenVolumeSeries(path));
  EXPECT_THAT(larger->Open(0, 0, 0).status(),
              StatusIs(kInvalid, HasSubstr("it has not the 2 x 2 x 5 samples")));
  WriteImaris(path, 0, "x");
  EXPECT_THAT(OpenVolumeSeries(path).status(),
              StatusIs(kInvalid, HasSubstr("an Imaris file with 0 steps")));
}

// What ITK writes itself is in itk_hdf_image_test.cc.
TEST_F(Hdf5MeshSeriesTest, ItkImagesWithoutTheNumbersOfAGridAreRefused) {
  const std::string path = dir_.Sub("a.h5");
  const std::vector<double> numbers{1, 0, 0, 0, 1, 0, 0, 0, 1};
  for (const std::string broken : {"", "Origin", "Spacing", "Directions", "VoxelData"}) {
    {
      Hdf5MeshWriter writer(path);
      writer.Group("/ITKImage");
      writer.Group("/ITKImage/0");
      for (const std::string name : {"Origin", "Spacing", "Directions"}) {
        const hsize_t right = name == "Directions" ? 9 : 3;
        testing::WriteHdf5Dataset(writer.file(), "/ITKImage/0/" + name,
                                  {name == broken ? hsize_t{2} : right}, H5T_NATIVE_DOUBLE,
                                  numbers.data());
      }
      if (broken == "VoxelData") {
        writer.Ramp("/ITKImage/0/VoxelData", {2, 3, 4, 0});
      } else {
        writer.Ramp("/ITKImage/0/VoxelData", {2, 3, 4});
      }
    }
    const auto series = OpenVolumeSeries(path);
    if (!broken.empty()) {
      EXPECT_THAT(series.status(), StatusIs(kInvalid, HasSubstr("/ITKImage/0/" + broken)));
      continue;
    }
    // The second axis has no spacing.
    ISOSCOPE_ASSERT_OK(series.status());
    EXPECT_THAT((*series)->Open(0, 0, 0).status(), StatusIs(kInvalid, HasSubstr("spacing")));
  }
}

}  // namespace
}  // namespace isoscope::source
