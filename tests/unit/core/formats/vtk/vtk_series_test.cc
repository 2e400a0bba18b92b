#include "core/formats/vtk/vtk_series.h"

#include <memory>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/open_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::BytesOf;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::ValuesOf;
using ::isoscope::testing::VtiBytes;
using ::isoscope::testing::VtiImageFile;
using ::isoscope::testing::WriteFile;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

// 2 x 3 x 2 points: p = step, v = (step, 2 step, 3 step).
VtiImageFile Step(float step) {
  std::vector<float> v;
  for (int i = 0; i < 12; ++i) {
    v.insert(v.end(), {step, 2 * step, 3 * step});
  }
  return {
      .extent = "0 1 0 2 0 1",
      .fields = {{.name = "p", .type = "Float32", .samples = BytesOf(std::vector<float>(12, step))},
                 {.name = "v", .type = "Float32", .samples = BytesOf(v), .components = 3}},
      .field_data =
          "<FieldData><DataArray type=\"Float64\" Name=\"TimeValue\" "
          "format=\"ascii\">1.5</DataArray></FieldData>"};
}

std::string PvdBytes(const std::vector<std::pair<std::string, std::string>>& steps) {
  std::string text = "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\">\n<Collection>\n";
  for (const auto& [time, file] : steps) {
    absl::StrAppend(&text, "<DataSet timestep=\"", time, "\" group=\"\" part=\"0\" file=\"", file,
                    "\"/>\n");
  }
  return text + "</Collection>\n</VTKFile>\n";
}

class VtkSeriesTest : public ::testing::Test {
 protected:
  std::string Write(const std::string& name, const std::string& bytes) {
    WriteFile(dir_.Sub(name), bytes);
    return dir_.Sub(name);
  }
  // The first sample; -1 and a failure if it can't be read.
  static float First(VolumeSeries& series, int field, int component, int step) {
    auto source = series.Open(field, component, step);
    EXPECT_TRUE(source.ok()) << source.status();
    auto bytes = source.ok() ? ReadAll(**source, 2) : source.status();
    return bytes.ok() ? ValuesOf<float>(*bytes)[0] : -1;
  }
  TempDir dir_;
};

TEST_F(VtkSeriesTest, ImageHasOneStepWithItsTime) {
  const std::string path = Write("a.vti", VtiBytes(Step(4)));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto all, OpenVtkImageSeries(path, ""));
  EXPECT_EQ(all->info().name, path);
  EXPECT_THAT(all->info().times, ElementsAre(1.5));
  ASSERT_EQ(all->info().fields.size(), 2u);
  EXPECT_EQ(First(*all, 0, 0, 0), 4);
  EXPECT_EQ(First(*all, 1, 2, 0), 12);
  EXPECT_EQ(all->info().time_unit, "");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto array, OpenVtkImageSeries(path, "v"));
  EXPECT_TRUE(array->info().times.empty());
  ASSERT_EQ(array->info().fields.size(), 1u);
  EXPECT_EQ(array->info().fields[0].components.size(), 3u);
  EXPECT_EQ(First(*array, 0, 1, 0), 8);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto component, OpenVtkImageSeries(path, "v:2"));
  EXPECT_EQ(component->info().fields[0].name, "v");
  EXPECT_THAT(component->info().fields[0].components, ElementsAre(""));
  EXPECT_EQ(First(*component, 0, 0, 0), 12);
}

TEST_F(VtkSeriesTest, StepsMayBeRectilinearGridsOfEvenAxes) {
  const auto grid = [](const char* x, int first) {
    return absl::StrCat(
        "<VTKFile type=\"RectilinearGrid\"><RectilinearGrid WholeExtent=\"0 2 0 1 0 1\">"
        "<Piece Extent=\"0 2 0 1 0 1\"><PointData><DataArray type=\"Float32\" Name=\"p\" "
        "format=\"ascii\">",
        first,
        " 1 2 3 4 5 6 7 8 9 10 11</DataArray></PointData><Coordinates>"
        "<DataArray type=\"Float32\" format=\"ascii\">",
        x,
        "</DataArray><DataArray type=\"Float32\" format=\"ascii\">0 1</DataArray>"
        "<DataArray type=\"Float32\" format=\"ascii\">0 1</DataArray></Coordinates></Piece>"
        "</RectilinearGrid></VTKFile>");
  };
  Write("s0.vtr", grid("0 1 2", 20));
  Write("s1.vtr", grid("0 1 2", 30));
  Write("s2.vtr", grid("0 1 3", 40));
  const std::string path =
      Write("run.pvd", PvdBytes({{"0", "s0.vtr"}, {"1", "s1.vtr"}, {"2", "s2.vtr"}}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenPvdSeries(path));
  EXPECT_EQ(First(*series, 0, 0, 0), 20);
  EXPECT_EQ(First(*series, 0, 0, 1), 30);
  EXPECT_THAT(series->Open(0, 0, 2), StatusIs(kInvalid, HasSubstr("axis \"x\" is not even")));
}

TEST_F(VtkSeriesTest, CollectionHasAStepForEachFile) {
  for (int i = 0; i < 4; ++i) {
    Write(absl::StrCat("s", i, ".vti"), VtiBytes(Step(static_cast<float>(i + 1))));
  }
  const std::string path = Write(
      "run.pvd",
      PvdBytes(
          {{"-1", "s0.vti"}, {"0", "s1.vti"}, {"0.5", dir_.Sub("s2.vti")}, {"1e3", "s3.vti"}}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenPvdSeries(path));
  EXPECT_THAT(series->info().times, ElementsAre(-1, 0, 0.5, 1000));
  EXPECT_EQ(series->info().step_count(), 4);
  for (const int step : {0, 1, 2, 3, 1, 0}) {
    EXPECT_EQ(First(*series, 0, 0, step), static_cast<float>(step + 1));
    EXPECT_EQ(First(*series, 1, 2, step), static_cast<float>(3 * step + 3));
  }
}

TEST_F(VtkSeriesTest, TimesMustAscend) {
  const auto read = [&](const std::vector<std::pair<std::string, std::string>>& steps) {
    return ReadPvdSteps(Write("run.pvd", PvdBytes(steps))).status();
  };
  ISOSCOPE_EXPECT_OK(read({{"0", "a.vti"}, {"1", "b.PVTI"}}));
  EXPECT_THAT(
      read({{"0", "a.vti"}, {"2", "b.vti"}, {"1", "c.vti"}}),
      StatusIs(kInvalid, AllOf(HasSubstr("run.pvd: line 6"), HasSubstr("timestep 1 ("),
                               HasSubstr("c.vti) behind timestep 2 ("), HasSubstr("b.vti)"))));
  EXPECT_THAT(read({{"0", "a.vti"}, {"0", "b.vti"}}), StatusIs(kInvalid, HasSubstr("each once")));
  EXPECT_THAT(read({{"nan", "a.vti"}}), StatusIs(kInvalid, HasSubstr("timestep=\"nan\"")));
  EXPECT_THAT(read({{"", "a.vti"}}), StatusIs(kInvalid, HasSubstr("timestep=\"\"")));
  EXPECT_THAT(read({{"0", "a.vtu"}}), StatusIs(kInvalid, HasSubstr("file=\"a.vtu\"")));
  EXPECT_THAT(read({}), StatusIs(kInvalid, HasSubstr("without a DataSet")));
  EXPECT_THAT(ReadPvdSteps(Write("run.pvd", "<VTKFile/>")),
              StatusIs(kInvalid, HasSubstr("no ParaView collection")));
}

TEST_F(VtkSeriesTest, StepUnlikeTheFirstIsNamedAndOthersStillOpen) {
  Write("s0.vti", VtiBytes(Step(1)));
  VtiImageFile without = Step(2);
  without.fields.pop_back();
  Write("s1.vti", VtiBytes(without));
  VtiImageFile wider = Step(3);
  wider.image = "Origin=\"10 20 30\" Spacing=\"0.5 2 5\"";
  Write("s2.vti", VtiBytes(wider));
  VtiImageFile doubles = Step(4);
  doubles.fields[0].type = "Float64";
  doubles.fields[0].samples = BytesOf(std::vector<double>(12, 4));
  Write("s3.vti", VtiBytes(doubles));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series,
                                OpenPvdSeries(Write("run.pvd", PvdBytes({{"0", "s0.vti"},
                                                                         {"1", "s1.vti"},
                                                                         {"2", "s2.vti"},
                                                                         {"3", "s3.vti"},
                                                                         {"4", "none.vti"}}))));
  EXPECT_EQ(First(*series, 0, 0, 1), 2);
  EXPECT_THAT(series->Open(1, 0, 1),
              StatusIs(kInvalid, AllOf(HasSubstr("s1.vti: field \"v\" at step 1 (time 1)"),
                                       HasSubstr("no point array of that name"))));
  EXPECT_THAT(series->Open(0, 0, 2),
              StatusIs(kInvalid, AllOf(HasSubstr("s2.vti: field \"p\" at step 2"),
                                       HasSubstr("0.5 x 2 x 5 apart"), HasSubstr("one grid"))));
  EXPECT_THAT(series->Open(0, 0, 3),
              StatusIs(kInvalid, AllOf(HasSubstr("s3.vti"), HasSubstr("Float64 of 1 components"))));
  EXPECT_THAT(series->Open(0, 0, 4), StatusIs(absl::StatusCode::kNotFound, HasSubstr("none.vti")));
  EXPECT_EQ(First(*series, 1, 0, 0), 1);
}

TEST_F(VtkSeriesTest, AKeyInTheTimeBelongsNeitherToItsTextNorToAnArray) {
  for (const char* text : {"<InformationKey name=\"UNITS_LABEL\">ms</InformationKey>2.5",
                           "2.5<InformationKey name=\"UNITS_LABEL\"> ms </InformationKey>",
                           "<InformationKey name=\"OTHER\">7</InformationKey>2.5"}) {
    VtiImageFile image = Step(1);
    image.field_data =
        absl::StrCat("<FieldData><DataArray type=\"Float64\" Name=\"TimeValue\" format=\"ascii\">",
                     text, "</DataArray></FieldData>");
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series,
                                  OpenVolumeSeries(Write("key.vti", VtiBytes(image))));
    EXPECT_THAT(series->info().times, ElementsAre(2.5)) << text;
    EXPECT_EQ(series->info().time_unit, absl::StrContains(text, "UNITS") ? "ms" : "") << text;
    EXPECT_EQ(series->info().fields[0].unit, "");
  }
}

}  // namespace
}  // namespace isoscope::source
