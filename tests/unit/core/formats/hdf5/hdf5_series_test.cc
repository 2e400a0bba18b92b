#include "core/formats/hdf5/hdf5_series.h"

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/source/hdf5/hdf5_handle.h"
#include "hdf5.h"
#include "tests/support/hdf5_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::ReadAll;
using ::isoscope::testing::ReadFile;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::ValuesOf;
using ::isoscope::testing::WriteFile;
using ::isoscope::testing::WriteHdf5Dataset;
using ::isoscope::testing::WriteHdf5Scales;
using ::isoscope::testing::WriteHdf5Texts;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

class Hdf5SeriesTest : public ::testing::Test {
 protected:
  // Elements are their indices: the sum of index * stride.
  void Write(const std::string& name, const std::vector<hsize_t>& dims,
             const std::vector<hsize_t>& chunk = {}) {
    std::size_t count = 1;
    for (const hsize_t size : dims) {
      count *= size;
    }
    std::vector<std::int32_t> values(count);
    for (std::size_t i = 0; i < count; ++i) {
      values[i] = static_cast<std::int32_t>(i);
    }
    WriteHdf5Dataset(file_.get(), name, dims, H5T_STD_I32LE, values.data(), chunk);
  }
  void Close() { file_ = Hdf5Handle(); }
  TempDir dir_;
  const std::string path_ = dir_.Sub("run.h5");
  Hdf5Handle file_{H5Fcreate(path_.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT), H5Fclose};
};

// Every volume of every order of axes, whole and in single rows, against the index of the element.
TEST_F(Hdf5SeriesTest, EveryStepAndComponentOfEveryOrder) {
  struct Row {
    const char* letters;
    std::vector<hsize_t> dims;
  };
  const std::vector<Row> rows{{"ZYX", {3, 4, 5}},         {"TZYX", {2, 3, 4, 5}},
                              {"CZYX", {2, 3, 4, 5}},     {"ZYXC", {3, 4, 5, 2}},
                              {"ZTYX", {3, 2, 4, 5}},     {"TCZYX", {2, 3, 4, 5, 6}},
                              {"TZYXC", {3, 2, 4, 5, 2}}, {"CTZYX", {2, 3, 4, 5, 6}},
                              {"TZCYX", {2, 4, 3, 5, 6}}, {"T-ZYX", {2, 1, 3, 4, 5}}};
  for (const bool is_chunked : {false, true}) {
    for (const Row& row : rows) {
      // A chunk is no larger than its dataset.
      if (!is_chunked || std::string(row.letters).find('-') == std::string::npos) {
        Write(std::string(is_chunked ? "c" : "p") + row.letters, row.dims,
              is_chunked ? std::vector<hsize_t>(row.dims.size(), 2) : std::vector<hsize_t>{});
      }
    }
  }
  Close();
  for (const std::string prefix : {"p", "c"}) {
    for (const Row& row : rows) {
      SCOPED_TRACE(prefix + row.letters);
      const std::string letters = row.letters;
      if (prefix == "c" && letters.find('-') != std::string::npos) {
        continue;
      }
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series,
                                    OpenHdf5Series(path_ + ":/" + prefix + letters, letters));
      const auto axis = [&](char letter) { return letters.find(letter); };
      const auto size = [&](char letter) {
        return axis(letter) == std::string::npos ? 1 : static_cast<int>(row.dims[axis(letter)]);
      };
      ASSERT_EQ(series->info().fields.size(), 1u);
      EXPECT_EQ(series->info().fields[0].name, prefix + letters);
      EXPECT_EQ(static_cast<int>(series->info().fields[0].components.size()), size('C'));
      EXPECT_EQ(series->info().step_count(), size('T'));
      for (int step = 0; step < size('T'); ++step) {
        for (int component = 0; component < size('C'); ++component) {
          ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, series->Open(0, component, step));
          std::vector<std::int32_t> expected;
          for (int z = 0; z < size('Z'); ++z) {
            for (int y = 0; y < size('Y'); ++y) {
              for (int x = 0; x < size('X'); ++x) {
                std::int32_t index = 0;
                for (std::size_t i = 0; i < letters.size(); ++i) {
                  const int at = letters[i] == 'T'   ? step
                                 : letters[i] == 'C' ? component
                                 : letters[i] == 'Z' ? z
                                 : letters[i] == 'Y' ? y
                                 : letters[i] == 'X' ? x
                                                     : 0;
                  index = index * static_cast<std::int32_t>(row.dims[i]) + at;
                }
                expected.push_back(index);
              }
            }
          }
          ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadAll(*source, 2));
          ASSERT_EQ(ValuesOf<std::int32_t>(bytes), expected) << step << " " << component;
        }
      }
    }
  }
}

TEST_F(Hdf5SeriesTest, AttributesGiveAxesTimesAndUnits) {
  Write("velocity", {2, 4, 5, 6, 3});
  const std::vector<double> times{0.25, 4};
  WriteHdf5Dataset(file_.get(), "time", {2}, H5T_IEEE_F64LE, times.data());
  WriteHdf5Texts(file_.get(), "time", "units", {"ms"});
  WriteHdf5Texts(file_.get(), "velocity", "units", {"m/s"});
  WriteHdf5Texts(file_.get(), "velocity", "long_name", {"velocity of the fluid"});
  WriteHdf5Texts(file_.get(), "velocity", "DIMENSION_LABELS", {"", "z", "y", "x", "component"});
  WriteHdf5Scales(file_.get(), "velocity", {"/time", "", "", "", ""});
  Close();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenHdf5Series(path_, ""));
  EXPECT_EQ(series->info().name, path_);
  const SourceField& field = series->info().fields[0];
  EXPECT_EQ(field.name, "velocity");
  EXPECT_EQ(field.unit, "m/s");
  EXPECT_EQ(field.long_name, "velocity of the fluid");
  EXPECT_THAT(field.components, ElementsAre("x", "y", "z"));
  EXPECT_THAT(series->info().times, ElementsAre(0.25, 4));
  EXPECT_EQ(series->info().time_unit, "ms");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, series->Open(0, 2, 1));
  EXPECT_EQ(source->info().geometry.sample_dims, (math::Index3{6, 5, 4}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadAll(*source, 4));
  EXPECT_EQ(ValuesOf<std::int32_t>(bytes)[0], 4 * 5 * 6 * 3 + 2);
}

TEST_F(Hdf5SeriesTest, VolumeIsASeriesWithoutTime) {
  Write("a", {1, 3, 4, 5});
  Close();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenHdf5Series(path_ + ":a", ""));
  EXPECT_EQ(series->info().fields[0].name, "a");
  EXPECT_THAT(series->info().fields[0].components, ElementsAre(""));
  EXPECT_THAT(series->info().times, IsEmpty());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, series->Open(0, 0, 0));
  EXPECT_EQ(source->info().geometry.sample_dims, (math::Index3{5, 4, 3}));
}

TEST_F(Hdf5SeriesTest, MissingOrWrongAxesAreErrorsWithTheShapeAndTheChoices) {
  Write("u", {2, 3, 4, 5});
  Write("v", {2, 3, 4, 5, 6});
  Write("w", {2, 2, 2, 3, 4, 5});
  Write("thin", {2, 1, 4, 5});
  Close();
  const auto status = [&](const std::string& name, const std::string& axes) {
    return OpenHdf5Series(path_ + ":/" + name, axes).status();
  };
  EXPECT_THAT(
      status("u", ""),
      StatusIs(kInvalid,
               AllOf(HasSubstr("4 axes (2 x 3 x 4 x 5 elements)"), HasSubstr("TZYX, CZYX or ZYXC"),
                     HasSubstr("isoscope partition " + path_ + ":/u --axes TZYX --output DIR"))));
  EXPECT_THAT(status("v", ""), StatusIs(kInvalid, HasSubstr("--axes TCZYX --output")));
  // The advice works when it is followed.
  for (const char* name : {"u", "v"}) {
    const std::string message(status(name, "").message());
    const std::size_t begin = message.find("--axes ") + 7;
    EXPECT_TRUE(status(name, message.substr(begin, message.find(' ', begin) - begin)).ok())
        << message;
  }
  EXPECT_THAT(status("w", ""), StatusIs(kInvalid, HasSubstr("expected 3 to 5")));
  EXPECT_THAT(status("u", "ZYX"), StatusIs(kInvalid, HasSubstr("expected 4 letters")));
  EXPECT_THAT(status("u", "TXYX"), StatusIs(kInvalid, HasSubstr("Z, Y and X in any order")));
  EXPECT_THAT(status("u", "-ZYX"), StatusIs(kInvalid, HasSubstr("leaves out axis 0")));
  EXPECT_THAT(status("u", std::string(100, 'T')), StatusIs(kInvalid, HasSubstr("100 letters")));
  EXPECT_THAT(status("none", ""), StatusIs(absl::StatusCode::kNotFound, HasSubstr("/u")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto thin, OpenHdf5Series(path_ + ":/thin", "TZYX"));
  EXPECT_THAT(thin->Open(0, 0, 0), StatusIs(kInvalid, HasSubstr("at least 2")));
  EXPECT_THAT(OpenHdf5Series(dir_.Sub("none.h5"), ""),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("none.h5")));
}

TEST_F(Hdf5SeriesTest, IntegersThatAreNotExactAreNamed) {
  std::vector<std::int64_t> values(2 * 2 * 3 * 2, 1);
  values[12 + 5] = (std::int64_t{1} << 53) + 1;
  WriteHdf5Dataset(file_.get(), "ids", {2, 2, 3, 2}, H5T_STD_I64LE, values.data());
  Close();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenHdf5Series(path_, "TZYX"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto first, series->Open(0, 0, 0));
  EXPECT_EQ(first->info().type, volume::ScalarType::kFloat64);
  ISOSCOPE_EXPECT_OK(ReadAll(*first, 2).status());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto second, series->Open(0, 0, 1));
  EXPECT_THAT(ReadAll(*second, 2),
              StatusIs(kInvalid, AllOf(HasSubstr("(1, 2, 0) is 9007199254740993"),
                                       HasSubstr("run.h5:/ids"))));
}

TEST_F(Hdf5SeriesTest, FlippedFilesNeverCrash) {
  Write("u", {2, 2, 3, 4}, {1, 2, 3, 4});
  const std::vector<double> times{1, 2};
  WriteHdf5Dataset(file_.get(), "time", {2}, H5T_IEEE_F64LE, times.data());
  WriteHdf5Texts(file_.get(), "u", "DIMENSION_LABELS", {"t", "z", "y", "x"});
  WriteHdf5Scales(file_.get(), "u", {"/time", "", "", ""});
  Close();
  const std::string whole = ReadFile(path_);
  for (std::size_t at = 0; at < whole.size(); at += 173) {
    std::string flipped = whole;
    flipped[at] = static_cast<char>(flipped[at] ^ 0x41);
    WriteFile(dir_.Sub("cut.h5"), flipped);
    const auto series = OpenHdf5Series(dir_.Sub("cut.h5") + ":/u", "");
    if (series.ok() && (*series)->info().step_count() == 2) {
      const auto source = (*series)->Open(0, 0, 1);
      if (source.ok() && math::Volume((*source)->info().geometry.sample_dims) <= 24) {
        static_cast<void>(ReadAll(**source, 2));
      }
    }
  }
}

}  // namespace
}  // namespace isoscope::source
