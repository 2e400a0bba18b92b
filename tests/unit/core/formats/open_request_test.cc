// Symptom: `partition --resume` went on with volumes that another --crop or --fill had made.

#include "core/formats/open_request.h"

#include <cstring>
#include <filesystem>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/source/bytes/raw_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

namespace fs = std::filesystem;

using ::isoscope::testing::NiftiHeaderBytes;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::VtiBytes;
using ::isoscope::testing::WriteFile;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

// Requests that differ from `base` in one member or one part of it.
std::vector<OpenRequest> Neighbours(const OpenRequest& base) {
  std::vector<OpenRequest> all;
  const auto add = [&](auto change) {
    OpenRequest request = base;
    change(request);
    all.push_back(std::move(request));
  };
  const RawFormat raw{.dims = {4, 3, 2}};
  add([](auto& r) { r.path += "2"; });
  add([&](auto& r) { r.raw = raw; });
  add([&](auto& r) { (r.raw = raw)->dims.x = 5; });
  add([&](auto& r) { (r.raw = raw)->dims.y = 5; });
  add([&](auto& r) { (r.raw = raw)->dims.z = 5; });
  add([&](auto& r) { (r.raw = raw)->type = volume::ScalarType::kInt8; });
  add([&](auto& r) { (r.raw = raw)->is_big_endian = true; });
  add([&](auto& r) { (r.raw = raw)->header_bytes = 3; });
  add([](auto& r) { r.format = "nrrd"; });
  add([](auto& r) { r.dicom_series = "nrrd"; });
  add([](auto& r) { r.axes = "nrrd"; });
  add([](auto& r) { r.ignores_shear = true; });
  add([](auto& r) { r.resamples = true; });
  for (int axis = 0; axis < 3; ++axis) {
    add([&](auto& r) { (r.grid.spacing = math::Vec3d{1, 1, 1}).value()[axis] = 2; });
    add([&](auto& r) { (r.grid.origin = math::Vec3d{1, 1, 1}).value()[axis] = 2; });
    add([&](auto& r) {
      (r.grid.direction = math::Mat3d()).value().columns[static_cast<std::size_t>(axis)].x = 0.5;
    });
  }
  add([](auto& r) { r.grid.spacing = math::Vec3d{1, 1, 1}; });
  add([](auto& r) { r.grid.origin = math::Vec3d{1, 1, 1}; });
  add([](auto& r) { r.grid.direction = math::Mat3d(); });
  for (int axis = 0; axis < 3; ++axis) {
    add([&](auto& r) { (r.crop = SampleBox{{0, 0, 0}, {4, 4, 4}})->begin[axis] = 1; });
    add([&](auto& r) { (r.crop = SampleBox{{0, 0, 0}, {4, 4, 4}})->end[axis] = 3; });
  }
  add([](auto& r) { r.stride = 2; });
  add([](auto& r) { r.fill = 0.0; });
  add([](auto& r) { r.fill = 293.15; });
  add([](auto& r) { r.fill = 293.15000000000003; });
  add([](auto& r) { r.fields = {"a", "b"}; });
  add([](auto& r) { r.fields = {"b", "a"}; });
  add([](auto& r) { r.fields = {"a,b"}; });
  add([](auto& r) { r.fields = {"a\",\"b"}; });
  add([](auto& r) { r.fields = {"a\nsteps none"}; });
  add([](auto& r) { r.steps = StepRange{.first = 0, .last = 4, .stride = 1}; });
  add([](auto& r) { r.steps = StepRange{.first = 1, .last = 4, .stride = 1}; });
  add([](auto& r) { r.steps = StepRange{.first = 0, .last = 3, .stride = 1}; });
  add([](auto& r) { r.steps = StepRange{.first = 0, .last = 4, .stride = 2}; });
  add([](auto& r) { r.time = 0.0; });
  add([](auto& r) { r.time = 1.0; });
  add([](auto& r) { r.label_names = "names.txt"; });
  return all;
}

TEST(OpenRequestTest, EachMemberAndEachPartOfItChangesTheDescription) {
  std::set<std::string> known{Describe({.path = "/data/run.h5"}).value()};
  for (const OpenRequest& request : Neighbours({.path = "/data/run.h5"})) {
    const std::string text = Describe(request).value();
    EXPECT_TRUE(known.insert(text).second) << text;
    EXPECT_EQ(Describe(request).value(), text);
  }
}

TEST(OpenRequestTest, TheSameFileByAnotherPathHasOneDescription) {
  const TempDir dir;
  WriteFile(dir.Sub("v.raw"), "x");
  fs::create_symlink("v.raw", dir.Sub("link.raw"));
  EXPECT_EQ(Describe({.path = dir.Sub("link.raw")}).value(),
            Describe({.path = dir.Sub("./v.raw")}).value());
  EXPECT_EQ(Describe({.path = "v", .label_names = dir.Sub("link.raw")}).value(),
            Describe({.path = "v", .label_names = dir.Sub("v.raw")}).value());
}

class OpenedRequestTest : public ::testing::Test {
 protected:
  OpenedRequestTest() {
    std::string samples;
    for (int i = 0; i < 24; ++i) {
      samples += static_cast<char>(i);
    }
    WriteFile(path_, samples);
  }
  [[nodiscard]] OpenRequest Raw() const {
    return {.path = path_, .raw = RawFormat{.dims = {4, 3, 2}}};
  }
  const TempDir dir_;
  const std::string path_ = dir_.Sub("v.raw");
};

TEST_F(OpenedRequestTest, PlacesThenCropsThenSelects) {
  OpenRequest request = Raw();
  request.grid = {.spacing = math::Vec3d{2, 2, 2}, .origin = math::Vec3d{10, 0, 0}};
  request.crop = SampleBox{{1, 0, 0}, {4, 3, 2}};
  request.stride = 1;
  request.fill = 5.0;
  request.fields = {"density"};
  request.time = 4.5;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, Open(request));
  EXPECT_EQ(series->info().fields[0].name, "density");
  EXPECT_THAT(series->info().times, ElementsAre(4.5));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(0, 0, 0));
  EXPECT_EQ(volume->info().geometry.spacing, (math::Vec3d{2, 2, 2}));
  EXPECT_EQ(volume->info().geometry.origin, (math::Vec3d{12, 0, 0}));
  EXPECT_EQ(volume->info().type, volume::ScalarType::kFloat32);
  EXPECT_EQ(volume->info().note, "") << "a raw file has no grid of its own";
  request.stride = 2;
  request.crop.reset();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto strided, Open(request));
  EXPECT_THAT(strided->Open(0, 0, 0), StatusIs(kInvalid, HasSubstr("--stride")));
  request = Raw();
  request.axes = "ZYX";
  EXPECT_THAT(Open(request), StatusIs(kInvalid, HasSubstr("raw file lie as ZYX")));
}

TEST_F(OpenedRequestTest, AFileThatChangesOnceItWasOpenedIsToldNotMixed) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenIdentified(Raw()));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string identity, series->IdentityOfStep(0));
  EXPECT_THAT(identity, HasSubstr(Describe(Raw()).value()));
  ISOSCOPE_EXPECT_OK(series->Open(0, 0, 0));
  EXPECT_EQ(series->IdentityOfStep(0).value(), identity);
  const auto time = fs::last_write_time(path_);
  WriteFile(path_, std::string(24, 'x'));
  fs::last_write_time(path_, time);
  EXPECT_THAT(series->IdentityOfStep(0),
              StatusIs(absl::StatusCode::kAborted, HasSubstr("has changed since it was opened")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto again, OpenIdentified(Raw()));
  EXPECT_NE(again->IdentityOfStep(0).value(), identity);
}

TEST_F(OpenedRequestTest, WithoutItsRequestASeriesHasNoIdentity) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, Open(Raw()));
  EXPECT_THAT(series->IdentityOfStep(0), StatusIs(absl::StatusCode::kUnimplemented));
}

// A simulation appends steps to its collection while earlier ones are partitioned.
TEST_F(OpenedRequestTest, AStepOfACollectionDependsOnItsOwnFileAlone) {
  const auto write = [&](const std::string& name) {
    WriteFile(dir_.Sub(name), VtiBytes({.extent = "0 3 0 2 0 1",
                                        .fields = {{"p", "UInt8", std::string(24, name[0])}}}));
  };
  const auto collect = [&](const std::string& steps) {
    WriteFile(dir_.Sub("run.pvd"), "<VTKFile><Collection>" + steps + "</Collection></VTKFile>");
  };
  write("a.vti");
  write("b.vti");
  const std::string two =
      "<DataSet timestep=\"0\" file=\"a.vti\"/><DataSet timestep=\"1\" file=\"b.vti\"/>";
  collect(two);
  const OpenRequest request{.path = dir_.Sub("run.pvd")};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto before, OpenIdentified(request));
  const std::string first = before->IdentityOfStep(0).value();
  const std::string second = before->IdentityOfStep(1).value();
  EXPECT_NE(first, second);
  write("c.vti");
  collect(two + "<DataSet timestep=\"2\" file=\"c.vti\"/>");
  write("b.vti");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto after, OpenIdentified(request));
  EXPECT_EQ(after->IdentityOfStep(0).value(), first);
  EXPECT_NE(after->IdentityOfStep(1).value(), second);
  ISOSCOPE_EXPECT_OK(after->Open(0, 0, 1));
  write("b.vti");
  EXPECT_THAT(after->IdentityOfStep(1), StatusIs(absl::StatusCode::kAborted));
  EXPECT_EQ(after->IdentityOfStep(0).value(), first);
}

TEST_F(OpenedRequestTest, NamesOfLabelsAreAFileOfTheSource) {
  OpenRequest request = Raw();
  request.label_names = dir_.Sub("names.txt");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOf(request));
  EXPECT_THAT(files, ElementsAre(path_, dir_.Sub("names.txt")));
}

TEST_F(OpenedRequestTest, ADirectionTakesAFileThatWouldBeRefusedForItsShear) {
  const std::string path = dir_.Sub("v.nii");
  std::string bytes = NiftiHeaderBytes({.dims = {4, 3, 2}}) + std::string(48, 'x');
  const float shear = 1;
  std::memcpy(bytes.data() + 280 + 8, &shear, 4);  // world x of index z
  WriteFile(path, bytes);
  OpenRequest request{.path = path};
  ASSERT_THAT(Open(request), StatusIs(kInvalid, HasSubstr("--ignore-shear")));
  request.grid.direction = math::Mat3d();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, Open(request));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(0, 0, 0));
  EXPECT_EQ(volume->info().geometry.direction, math::Mat3d());
}

}  // namespace
}  // namespace isoscope::source
