#include "core/synthetic/flow_file.h"

#include <algorithm>
#include <csignal>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "oneapi/tbb/global_control.h"
#include <sys/resource.h>

#include "core/base/coding.h"
#include "core/formats/open_volume.h"
#include "core/source/volume_series.h"
#include "core/source/volume_source.h"
#include "core/synthetic/flow_generator.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::ReadAll;
using ::isoscope::testing::ReadFile;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::WriteFile;
using ::testing::_;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

class FlowFileTest : public ::testing::Test {
 protected:
  static std::string SamplesOf(const FlowFieldRow& field, const math::Index3& dims, double time) {
    const FlowInstant flow(FlowGrid(dims).value(), time);
    std::string samples(
        static_cast<std::size_t>(math::Volume(dims) * field.component_count) * sizeof(float), '\0');
    flow.FillRows(field.field, 0, dims.y * dims.z, samples.data());
    return samples;
  }
  // A flow of three steps; a step's arrays are of 3 MB or less.
  FlowFileOptions Options() const {
    return {.path = dir_.Sub("f.pvd"), .dims = {128, 64, 32}, .step_count = 3};
  }
  // Sorted.
  std::vector<std::string> Entries() const {
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(dir_.path())) {
      names.push_back(entry.path().filename());
    }
    std::sort(names.begin(), names.end());
    return names;
  }

  TempDir dir_;
  base::Cancellation never_;
};

TEST_F(FlowFileTest, BytesOfATinyFlow) {
  const FlowFileOptions options{
      .path = dir_.Sub("f.pvd"), .dims = {3, 2, 2}, .step_count = 2, .time_step = 0.1};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::int64_t bytes, WriteFlow(options, never_));
  EXPECT_THAT(Entries(), ElementsAre("f.pvd", "f_00000.vti", "f_00001.vti"));
  EXPECT_EQ(ReadFile(dir_.Sub("f.pvd")), R"(<?xml version="1.0"?>
<VTKFile type="Collection" version="1.0" byte_order="LittleEndian" header_type="UInt64">
  <Collection TimeUnit="s">
    <DataSet timestep="0" part="0" file="f_00000.vti"/>
    <DataSet timestep="0.1" part="0" file="f_00001.vti"/>
  </Collection>
</VTKFile>
)");
  std::string expected = R"(<?xml version="1.0"?>
<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt64">
  <ImageData WholeExtent="0 2 0 1 0 1" Origin="-0.5 -0.25 -0.25" Spacing="0.5 0.5 0.5" Unit="m">
    <FieldData>
      <DataArray type="Float64" Name="TimeValue" NumberOfTuples="1" Unit="s" format="ascii">
        0.1
        <InformationKey name="UNITS_LABEL" location="vtkDataArray">s</InformationKey>
      </DataArray>
    </FieldData>
    <Piece Extent="0 2 0 1 0 1">
      <PointData Scalars="pressure" Vectors="velocity">
        <DataArray type="Float32" Name="pressure" NumberOfComponents="1" Unit="Pa" format="appended" offset="0">
          <InformationKey name="UNITS_LABEL" location="vtkDataArray">Pa</InformationKey>
        </DataArray>
        <DataArray type="Float32" Name="temperature" NumberOfComponents="1" Unit="K" format="appended" offset="56">
          <InformationKey name="UNITS_LABEL" location="vtkDataArray">K</InformationKey>
        </DataArray>
        <DataArray type="Float32" Name="velocity" NumberOfComponents="3" ComponentName0="x" ComponentName1="y" ComponentName2="z" Unit="m/s" format="appended" offset="112">
          <InformationKey name="UNITS_LABEL" location="vtkDataArray">m/s</InformationKey>
        </DataArray>
      </PointData>
      <CellData/>
    </Piece>
  </ImageData>
  <AppendedData encoding="raw">
   _)";
  for (const FlowFieldRow& field : kFlowFields) {
    const std::string samples = SamplesOf(field, options.dims, 0.1);
    base::AppendLittleEndian(std::uint64_t{samples.size()}, &expected);
    expected += samples;
  }
  expected += "\n  </AppendedData>\n</VTKFile>\n";
  EXPECT_EQ(ReadFile(dir_.Sub("f_00001.vti")), expected);
  EXPECT_EQ(bytes,
            static_cast<std::int64_t>(ReadFile(dir_.Sub("f.pvd")).size() +
                                      ReadFile(dir_.Sub("f_00000.vti")).size() + expected.size()));
}

TEST_F(FlowFileTest, EveryFieldIsAVolumeOfItsStep) {
  const FlowFileOptions options{
      .path = dir_.Sub("f.PVD"), .dims = {20, 11, 9}, .step_count = 2, .time_step = 1.5};
  ISOSCOPE_ASSERT_OK(WriteFlow(options, never_).status());
  for (const char* part : {"pressure", "temperature", "velocity:2"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source,
                                  OpenVolumeFile(absl::StrCat(dir_.Sub("f_00001.vti"), ":", part)));
    EXPECT_EQ(source->info().type, volume::ScalarType::kFloat32);
    EXPECT_EQ(source->info().geometry, FlowGrid(options.dims).value());
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string samples, ReadAll(*source, 4));
    const bool is_vector = std::string(part) == "velocity:2";
    const FlowFieldRow& field = kFlowFields[is_vector ? 2 : *part == 'p' ? 0 : 1];
    const std::string expected = SamplesOf(field, options.dims, 1.5);
    const auto tuple = 4 * static_cast<std::size_t>(field.component_count);
    for (std::size_t i = 0; i * 4 < samples.size(); ++i) {
      ASSERT_EQ(samples.substr(i * 4, 4), expected.substr(i * tuple + (is_vector ? 8 : 0), 4))
          << part << i;
    }
  }
}

TEST_F(FlowFileTest, BytesAreTheSameForEveryNumberOfThreads) {
  std::vector<std::string> first;
  for (const std::size_t threads : {1U, 2U, 5U}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    FlowFileOptions options = Options();
    std::int64_t last = 0;
    options.progress = [&](std::int64_t done, std::int64_t total) {
      EXPECT_GT(done, last);
      EXPECT_LE(done, total);
      last = done;
    };
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::int64_t bytes, WriteFlow(options, never_));
    std::vector<std::string> files;
    std::size_t size = 0;
    for (const std::string& name : Entries()) {
      files.push_back(ReadFile(dir_.Sub(name)));
      size += files.back().size();
    }
    EXPECT_EQ(static_cast<std::int64_t>(size), bytes);
    EXPECT_LT(bytes - last, 1000) << "the .pvd";
    first = first.empty() ? files : first;
    EXPECT_TRUE(files == first) << threads;
  }
}

TEST_F(FlowFileTest, CancellationLeavesNothingWheneverItComes) {
  std::int64_t call_count = 0;
  FlowFileOptions options = Options();
  options.progress = [&](std::int64_t, std::int64_t) { ++call_count; };
  ISOSCOPE_ASSERT_OK(WriteFlow(options, never_).status());
  for (const std::string& name : Entries()) {
    std::filesystem::remove(dir_.Sub(name));
  }
  for (std::int64_t last = 0; last <= call_count; ++last) {
    base::Cancellation cancellation;
    std::int64_t calls = 0;
    options.progress = [&](std::int64_t, std::int64_t) {
      if (++calls == last) {
        cancellation.Cancel();
      }
    };
    if (last == 0) {
      cancellation.Cancel();
    }
    EXPECT_THAT(WriteFlow(options, cancellation).status(),
                StatusIs(absl::StatusCode::kCancelled, _));
    EXPECT_THAT(Entries(), ElementsAre()) << last;
  }
}

TEST_F(FlowFileTest, FullDiskLeavesNothing) {
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto old_handler = std::signal(SIGXFSZ, SIG_IGN);
  rlimit small = before;
  small.rlim_cur = 3000000;
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
  const absl::Status status = WriteFlow(Options(), never_).status();
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &before), 0);
  std::signal(SIGXFSZ, old_handler);
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("f_00000.vti")));
  EXPECT_THAT(Entries(), ElementsAre());
}

TEST_F(FlowFileTest, FlowOfThatNameIsReplacedOnlyWhenTheNewOneIsWhole) {
  WriteFile(dir_.Sub("f.pvd"), "old");
  WriteFile(dir_.Sub("f_00001.vti"), "old");
  base::Cancellation cancellation;
  FlowFileOptions options = Options();
  options.progress = [&](std::int64_t done, std::int64_t total) {
    if (total - done < 1000) {  // the end of the last step
      cancellation.Cancel();
    }
  };
  EXPECT_THAT(WriteFlow(options, cancellation).status(), StatusIs(absl::StatusCode::kCancelled, _));
  EXPECT_THAT(Entries(), ElementsAre("f.pvd", "f_00001.vti"));
  EXPECT_EQ(ReadFile(dir_.Sub("f.pvd")), "old");
  EXPECT_EQ(ReadFile(dir_.Sub("f_00001.vti")), "old");
  ISOSCOPE_ASSERT_OK(WriteFlow(Options(), never_).status());
  EXPECT_THAT(Entries(), ElementsAre("f.pvd", "f_00000.vti", "f_00001.vti", "f_00002.vti"));
  EXPECT_NE(ReadFile(dir_.Sub("f.pvd")), "old");
  EXPECT_NE(ReadFile(dir_.Sub("f_00001.vti")), "old");
}

// The old collection would name steps of both flows.
TEST_F(FlowFileTest, StepThatCantGetItsNameLeavesNoCollection) {
  WriteFile(dir_.Sub("f.pvd"), "old");
  FlowFileOptions options = Options();
  options.progress = [&](std::int64_t done, std::int64_t total) {
    if (total - done < 1000) {
      std::filesystem::create_directory(dir_.Sub("f_00001.vti"));
    }
  };
  EXPECT_THAT(WriteFlow(options, never_).status(),
              StatusIs(absl::StatusCode::kAlreadyExists, HasSubstr("f_00001.vti")));
  EXPECT_THAT(Entries(), ElementsAre("f_00001.vti"));
}

TEST_F(FlowFileTest, FlowThatTheDiskCantHoldIsRefusedBeforeItIsBegun) {
  // 100000 times 20 * 2^24 bytes, and the headers.
  EXPECT_THAT(
      WriteFlow({.path = dir_.Sub("f.pvd"), .dims = {256, 256, 256}, .step_count = 100000}, never_)
          .status(),
      StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("fewer --steps")));
  EXPECT_THAT(
      WriteFlow({.path = dir_.Sub("f.pvd"), .dims = {1 << 19, 1 << 19, 1 << 18}, .step_count = 100},
                never_)
          .status(),
      StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("more than any disk holds")));
  EXPECT_THAT(Entries(), ElementsAre());
}

TEST_F(FlowFileTest, NamesAreEscapedInTheCollection) {
  ISOSCOPE_ASSERT_OK(
      WriteFlow({.path = dir_.Sub("a&\"<b>.pvd"), .dims = {2, 2, 2}}, never_).status());
  EXPECT_THAT(ReadFile(dir_.Sub("a&\"<b>.pvd")),
              HasSubstr("file=\"a&amp;&quot;&lt;b&gt;_00000.vti\""));
  EXPECT_THAT(Entries(), ElementsAre("a&\"<b>.pvd", "a&\"<b>_00000.vti"));
}

TEST_F(FlowFileTest, BadOptionsNamesAndPlacesAreRefused) {
  const auto status_of = [&](const std::function<void(FlowFileOptions*)>& change) {
    FlowFileOptions options = Options();
    change(&options);
    return WriteFlow(options, never_).status();
  };
  const auto named = [&](const std::string& name) {
    return status_of([&](FlowFileOptions* options) { options->path = dir_.Sub(name); });
  };
  const auto is_invalid = [](const std::string& text) {
    return StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(text));
  };
  EXPECT_THAT(named("f.vti"), is_invalid("a name that ends in .pvd"));
  EXPECT_THAT(named(".pvd"), is_invalid("a name that ends in .pvd"));
  EXPECT_THAT(named("absent/f.pvd"),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("absent/f_00000.vti")));
  EXPECT_THAT(status_of([](FlowFileOptions* options) { options->step_count = 0; }),
              is_invalid("0 time steps: expected 1 to 100000"));
  EXPECT_THAT(status_of([](FlowFileOptions* options) { options->time_step = 0; }),
              is_invalid("time step 0 s"));
  EXPECT_THAT(status_of([](FlowFileOptions* options) { options->time_step = 1e6; }),
              is_invalid("last time 2e+06 s: expected more than 0, and at most 1e+06"));
  EXPECT_THAT(status_of([](FlowFileOptions* options) { options->dims.y = 1; }), is_invalid(""));
  for (const char* name : {"f.pvd", "f_00002.vti"}) {
    std::filesystem::create_directory(dir_.Sub(name));
    EXPECT_THAT(named("f.pvd"), StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr(name)));
    EXPECT_THAT(Entries(), ElementsAre(name));
    std::filesystem::remove(dir_.Sub(name));
  }
}

TEST_F(FlowFileTest, ItsOwnReaderGetsFieldsTimesUnitsAndSamplesBack) {
  const FlowFileOptions options = Options();
  ISOSCOPE_ASSERT_OK(WriteFlow(options, never_).status());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(options.path));
  EXPECT_THAT(series->info().times, ElementsAre(0, 0.1, 0.2));
  EXPECT_EQ(series->info().time_unit, "s");
  EXPECT_EQ(series->info().length_unit, "m");
  ASSERT_EQ(series->info().fields.size(), kFlowFields.size());
  for (std::size_t i = 0; i < kFlowFields.size(); ++i) {
    EXPECT_EQ(series->info().fields[i].name, kFlowFields[i].name);
    EXPECT_EQ(series->info().fields[i].unit, kFlowFields[i].unit);
  }
  EXPECT_THAT(series->info().fields[2].components, ElementsAre("x", "y", "z"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pressure, series->Open(0, 0, 2));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string samples, ReadAll(*pressure, 8));
  EXPECT_EQ(samples, SamplesOf(kFlowFields[0], options.dims, 0.2));
}

}  // namespace
}  // namespace isoscope::source
