#include <cstdint>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "itkGiplImageIO.h"

#include "core/formats/medical/layout_formats.h"
#include "core/formats/open_volume.h"
#include "core/source/volume_series.h"
#include "tests/support/medical_files.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::GiplBytes;
using ::isoscope::testing::Gzip;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::WriteFile;
using ::testing::HasSubstr;

TEST(GiplLayoutTest, CornersTypesAndSteps) {
  const TempDir dir;
  std::string samples;
  for (int i = 0; i < 48; ++i) {  // int16, big-endian
    samples += {static_cast<char>(1), static_cast<char>(i)};
  }
  const std::string bytes = GiplBytes({.steps = 2}) + samples;
  WriteFile(dir.Sub("a.gipl"), bytes);
  WriteFile(dir.Sub("b.gipl.gz"), Gzip(bytes));
  WriteFile(dir.Sub("unnamed"), bytes);
  for (const char* name : {"a.gipl", "b.gipl.gz", "unnamed"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(dir.Sub(name)));
    EXPECT_EQ(series->step_count(), 2);
    EXPECT_EQ(series->length_unit(), "mm");
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, series->Open(0, 0, 1));
    EXPECT_EQ(source->geometry().sample_dims, (math::Index3{4, 3, 2}));
    EXPECT_EQ(source->geometry().spacing, (math::Vec3d{0.5, 1, 1.5}));
    EXPECT_EQ(source->geometry().origin, (math::Vec3d{10, 20, 30}));
    EXPECT_FALSE(source->patient_frame().has_value());
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*source, 1));
    const auto values = testing::ValuesOf<std::int16_t>(read);
    for (std::size_t i = 0; i < 24; ++i) {
      EXPECT_EQ(values[i], 256 + 24 + static_cast<int>(i)) << name;
    }
  }
}

TEST(GiplLayoutTest, WhatItkWritesComesBack) {
  const TempDir dir;
  std::vector<float> samples;
  for (int i = 0; i < 24; ++i) {
    samples.push_back(0.5F * static_cast<float>(i) - 3);
  }
  for (const char* name : {"a.gipl", "a.gipl.gz"}) {
    const auto io = itk::GiplImageIO::New();
    io->SetFileName(dir.Sub(name));
    io->SetNumberOfDimensions(3);
    itk::ImageIORegion region(3);
    const unsigned dims[] = {4, 3, 2};
    for (unsigned axis = 0; axis < 3; ++axis) {
      io->SetDimensions(axis, dims[axis]);
      io->SetSpacing(axis, 0.25 * (axis + 1));
      io->SetOrigin(axis, -7.5 * axis);
      region.SetSize(axis, dims[axis]);
      region.SetIndex(axis, 0);
    }
    io->SetComponentType(itk::IOComponentEnum::FLOAT);
    io->SetPixelType(itk::IOPixelEnum::SCALAR);
    io->SetNumberOfComponents(1);
    io->SetIORegion(region);
    io->WriteImageInformation();
    io->Write(samples.data());
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(dir.Sub(name)));
    EXPECT_EQ(source->geometry().sample_dims, (math::Index3{4, 3, 2}));
    EXPECT_EQ(source->geometry().spacing, (math::Vec3d{0.25, 0.5, 0.75}));
    EXPECT_EQ(source->geometry().origin, (math::Vec3d{0, -7.5, -15}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*source, 1));
    EXPECT_EQ(testing::ValuesOf<float>(read), samples) << name;
  }
}

TEST(GiplLayoutTest, DamagedFilesAreRefused) {
  const TempDir dir;
  const std::string path = dir.Sub("a.gipl");
  const std::string bytes = GiplBytes({}) + std::string(48, 'a');
  const auto error_of = [&](const std::string& written) {
    WriteFile(path, written);
    const auto source = OpenVolumeFile(path);
    return std::string(source.ok() ? ReadAll(**source, 1).status().message()
                                   : source.status().message());
  };
  EXPECT_EQ(error_of(bytes), "");
  EXPECT_THAT(error_of(bytes.substr(0, 200)), HasSubstr("has 200 bytes, expected 256"));
  EXPECT_THAT(error_of(bytes.substr(0, bytes.size() - 1)), HasSubstr("a.gipl"));
  EXPECT_THAT(error_of(GiplBytes({.mark = 1}) + std::string(48, 'a')), HasSubstr("0x00000001"));
  EXPECT_THAT(error_of(GiplBytes({.type = 1}) + std::string(48, 'a')), HasSubstr("GIPL type 1;"));
  EXPECT_THAT(error_of(GiplBytes({.dims = {4, 3, 0}}) + std::string(48, 'a')), HasSubstr("a.gipl"));
  const std::string zipped = Gzip(bytes);
  for (std::size_t i = 0; i < zipped.size(); i += 5) {
    EXPECT_THAT(error_of(zipped.substr(0, i)), HasSubstr("a.gipl")) << i;
  }
}

}  // namespace
}  // namespace isoscope::source
