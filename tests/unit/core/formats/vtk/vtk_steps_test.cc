#include "core/formats/vtk/vtk_steps.h"

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/open_volume.h"
#include "tests/support/folder_test.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::IsOk;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::VtiBytes;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr auto kNotFound = absl::StatusCode::kNotFound;

// 2 x 3 x 2 points of one value, with a time if it is not empty.
std::string StepBytes(char value, const std::string& time = "",
                      const std::string& extent = "0 1 0 2 0 1") {
  return VtiBytes({.extent = extent,
                   .fields = {{.name = "p", .type = "UInt8", .samples = std::string(12, value)},
                              {.name = "q", .type = "UInt8", .samples = std::string(12, 'q')}},
                   .field_data = time.empty()
                                     ? ""
                                     : absl::StrCat("<FieldData><DataArray type=\"Float64\" "
                                                    "Name=\"TimeValue\" format=\"ascii\">",
                                                    time, "</DataArray></FieldData>")});
}

std::string ListOf(const std::string& files) {
  return absl::StrCat("{\"file-series-version\": \"1.0\", \"files\": [", files, "]}");
}

class VtkStepsTest : public testing::FolderTest {
 protected:
  // The first sample of field p at each step.
  static std::string Firsts(VolumeSeries& series) {
    std::string firsts;
    for (int step = 0; step < series.info().step_count(); ++step) {
      const auto volume = series.Open(0, 0, step);
      const auto samples = volume.ok() ? ReadAll(**volume, 1) : volume.status();
      firsts += samples.ok() ? (*samples)[0] : '!';
    }
    return firsts;
  }
};

TEST_F(VtkStepsTest, AListHasTheTimesAndTheOrderOfItsFiles) {
  Write("b.vti", StepBytes('b', "9"));
  Write("a.vti", StepBytes('a'));
  const std::string path =
      Write("run.vti.series", ListOf("{\"name\": \"b.vti\", \"time\": 0.5}, "
                                     "{\"name\": \"a.vti\", \"time\": 2, \"more\": [1]}"));
  EXPECT_TRUE(IsVtkStepList(path));
  EXPECT_FALSE(IsVtkStepList("run.vti"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path));
  EXPECT_THAT(series->info().times, ElementsAre(0.5, 2));
  EXPECT_EQ(Firsts(*series), "ba");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfVolume(path));
  EXPECT_THAT(files, ElementsAre(path, dir_.Sub("b.vti"), dir_.Sub("a.vti")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto of_step, series->FilesOfStep(1));
  EXPECT_THAT(*of_step, ElementsAre(dir_.Sub("a.vti")));
  Write("run.vti.series", ListOf("{\"name\": \"a.vti\"}, {\"name\": \"b.vti\"}"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto numbered, OpenVolumeSeries(path));
  EXPECT_THAT(numbered->info().times, ElementsAre(0, 1));
}

TEST_F(VtkStepsTest, OtherListsAreRefused) {
  Write("a.vti", StepBytes('a'));
  const std::vector<std::pair<std::string, const char*>> cases = {
      {"", "no JSON"},
      {"[]", "no JSON"},
      {"{\"file-series-version\": \"1.0\"}", "no JSON"},
      {"{\"file-series-version\": \"1.0\", \"files\": [", "no JSON"},
      {std::string(100'000, '['), "no JSON"},
      {"{\"files\": [{\"name\": \"a.vti\"}]}", "file-series-version"},
      {"{\"file-series-version\": \"2.0\", \"files\": [{\"name\": \"a.vti\"}]}",
       "file-series-version"},
      {ListOf(""), "0 files"},
      {ListOf("1"), "without a \"name\""},
      {ListOf("{\"name\": 1}"), "without a \"name\""},
      {ListOf("{\"name\": \"a.vtu\"}"), "expected ImageData"},
      {ListOf("{\"name\": \"a.vti\", \"time\": \"0\"}"), "expected a finite number"},
      {ListOf("{\"name\": \"a.vti\", \"time\": 1e999}"), ""},
      {ListOf("{\"name\": \"a.vti\", \"time\": 1}, {\"name\": \"a.vti\"}"), "1 of 2 files"},
      {ListOf("{\"name\": \"a.vti\", \"time\": 1}, {\"name\": \"a.vti\", \"time\": 1}"),
       "expected times that ascend"}};
  for (const auto& [text, message] : cases) {
    EXPECT_THAT(ReadVtkStepList(Write("run.vti.series", text)),
                StatusIs(kInvalid, HasSubstr(message)))
        << text.substr(0, 100);
  }
  // Each element once: a parser that looks through the list for each of them needs hours.
  std::string many = "{}";
  for (int i = 1; i < 1'000'000; ++i) {
    many += ",{}";
  }
  EXPECT_THAT(ReadVtkStepList(Write("run.vti.series", ListOf(many))),
              StatusIs(kInvalid, HasSubstr("1000000 files; expected 1 to 100000")));
  // Brackets of names are no lists.
  const std::string brackets(50, '[');
  EXPECT_THAT(ReadVtkStepList(Write("run.vti.series", ListOf(absl::StrCat("{\"name\": \"\\\"",
                                                                          brackets, "a.vti\"}")))),
              IsOk());
  const std::string path = Write("run.vti.series", ListOf("{\"name\": \"none.vti\"}"));
  EXPECT_THAT(OpenVolumeSeries(path), StatusIs(kNotFound, HasSubstr("none.vti")));
}

TEST_F(VtkStepsTest, APatternIsStepsInTheOrderOfTheirNumbers) {
  Write("run_10.vti", StepBytes('c'));
  Write("run_9.vti", StepBytes('b'));
  Write("run_2.vti", StepBytes('a'));
  Write("other_1.vti", StepBytes('x'));
  const std::string pattern = dir_.Sub("run_*.vti");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(pattern));
  EXPECT_THAT(series->info().times, ElementsAre(0, 1, 2));
  EXPECT_EQ(series->info().fields.size(), 2U);
  EXPECT_EQ(Firsts(*series), "abc");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfVolume(pattern));
  EXPECT_THAT(files,
              ElementsAre(dir_.Sub("run_2.vti"), dir_.Sub("run_9.vti"), dir_.Sub("run_10.vti")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto part, OpenVolumeSeries(pattern + ":q"));
  EXPECT_EQ(part->info().fields.size(), 1U);
  EXPECT_EQ(Firsts(*part), "qqq");
  EXPECT_THAT(OpenVolumeSeries(pattern + ":x"), StatusIs(kNotFound));
  EXPECT_THAT(OpenVolumeSeries(dir_.Sub("none_*.vti")), StatusIs(kNotFound));
}

TEST_F(VtkStepsTest, FilesOfAPatternHaveTheirTimesOrNoneHas) {
  Write("r1.vti", StepBytes('a', "0.25"));
  Write("r2.vti", StepBytes('b', "0.75"));
  const std::string pattern = dir_.Sub("r?.vti");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(pattern));
  EXPECT_THAT(series->info().times, ElementsAre(0.25, 0.75));
  Write("r3.vti", StepBytes('c', "0.5"));
  EXPECT_THAT(OpenVolumeSeries(pattern), StatusIs(kInvalid, HasSubstr("times that ascend")));
  Write("r3.vti", StepBytes('c'));
  EXPECT_THAT(OpenVolumeSeries(pattern), StatusIs(kInvalid, HasSubstr("2 of 3 files")));
}

TEST_F(VtkStepsTest, AStepOfAnotherGridIsRefusedAsItIsOpened) {
  Write("g1.vti", StepBytes('a'));
  Write("g2.vti", StepBytes('b', "", "0 2 0 1 0 1"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(dir_.Sub("g*.vti")));
  EXPECT_EQ(Firsts(*series), "a!");
  EXPECT_THAT(series->Open(0, 0, 1), StatusIs(kInvalid, HasSubstr("g2.vti")));
}

}  // namespace
}  // namespace isoscope::source
