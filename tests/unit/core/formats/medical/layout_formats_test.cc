// NIfTI-2, Analyze, MGH, AFNI and PAR/REC: the world positions of the first and the last sample,
// the samples one by one, what is a step and what a field, and what is refused.

#include "core/formats/medical/layout_formats.h"

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/open_volume.h"
#include "core/source/grid/affine_grid.h"
#include "core/source/volume_series.h"
#include "core/source/volume_source.h"
#include "tests/support/medical_files.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::AfniBytes;
using ::isoscope::testing::AfniNumbers;
using ::isoscope::testing::AfniText;
using ::isoscope::testing::AnalyzeBytes;
using ::isoscope::testing::BytesOf;
using ::isoscope::testing::Gzip;
using ::isoscope::testing::MghBytes;
using ::isoscope::testing::Nifti2Bytes;
using ::isoscope::testing::ParBytes;
using ::isoscope::testing::ParImage;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::Swapped;
using ::isoscope::testing::ValuesOf;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr math::Index3 kDims{4, 3, 2};
constexpr int kSamples = 24;

// Sample i of volume v is 100 v + i.
std::string Volumes(int count) {
  std::vector<std::int16_t> values;
  for (int v = 0; v < count; ++v) {
    for (int i = 0; i < kSamples; ++i) {
      values.push_back(static_cast<std::int16_t>(100 * v + i));
    }
  }
  return BytesOf(values);
}

class LayoutFormatsTest : public ::testing::Test {
 protected:
  std::string Write(const std::string& name, const std::string& bytes) {
    testing::WriteFile(dir_.Sub(name), bytes);
    return dir_.Sub(name);
  }
  // All volumes in their order, and the corners of the grid, in LPS.
  static void Expect(const std::string& path, int volumes, const math::Vec3d& first,
                     const math::Vec3d& last, double slope = 1, double intercept = 0) {
    SCOPED_TRACE(path);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path));
    int v = 0;
    for (int field = 0; field < static_cast<int>(series->info().fields.size()); ++field) {
      const auto& components = series->info().fields[static_cast<std::size_t>(field)].components;
      for (int component = 0; component < static_cast<int>(components.size()); ++component) {
        for (int step = 0; step < series->info().step_count(); ++step, ++v) {
          ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, series->Open(field, component, step));
          ASSERT_EQ(source->info().geometry.sample_dims, kDims);
          const math::Mat4d to_world = source->info().geometry.world_from_index();
          EXPECT_LT(math::Length(math::TransformPoint(to_world, {0, 0, 0}) - first), 1e-5);
          EXPECT_LT(math::Length(math::TransformPoint(to_world, {3, 2, 1}) - last), 1e-5);
          ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadAll(*source, 1 + v % 2));
          std::vector<double> values;
          if (source->info().type == volume::ScalarType::kFloat32) {
            for (const float value : ValuesOf<float>(bytes)) {
              values.push_back(static_cast<double>(value));
            }
          } else {
            ASSERT_EQ(volume::SizeOf(source->info().type), 2U);
            for (const std::int16_t value : ValuesOf<std::int16_t>(bytes)) {
              values.push_back(value);
            }
          }
          ASSERT_EQ(values.size(), static_cast<std::size_t>(kSamples));
          for (int i = 0; i < kSamples; ++i) {
            ASSERT_EQ(values[static_cast<std::size_t>(i)], slope * (100 * v + i) + intercept) << v;
          }
        }
      }
    }
    EXPECT_EQ(v, volumes);
    EXPECT_EQ(OpenVolumeFile(path).ok(), volumes == 1);
  }
  static absl::Status Open(const std::string& path) {
    const auto series = OpenVolumeSeries(path);
    if (!series.ok()) {
      return series.status();
    }
    const auto source = (*series)->Open(0, 0, 0);
    return source.ok() ? ReadAll(**source, 1).status() : source.status();
  }
  testing::TempDir dir_;
};

// Has rows (0, -2, 0, 10), (1.5, 0, 0, 20), (0, 0, 3, 30), in RAS.
constexpr math::Vec3d kFirst{-10, -20, 30};
constexpr math::Vec3d kLast{-6, -24.5, 33};

TEST_F(LayoutFormatsTest, PairsMayBeGzipStreamsBoth) {
  Write("n2.hdr.gz", Gzip(Nifti2Bytes({.is_pair = true})));
  Write("n2.img.gz", Gzip(Volumes(1)));
  Write("n1.hdr.gz",
        Gzip(testing::NiftiHeaderBytes({.dims = kDims, .is_pair = true, .vox_offset = 0})));
  Write("n1.img.gz", Gzip(Volumes(1)));
  Write("a.hdr.gz", Gzip(AnalyzeBytes({})));
  Write("a.img.gz", Gzip(Volumes(1)));
  Write("half.hdr.gz", Gzip(AnalyzeBytes({})));
  Write("half.img", Volumes(1));
  for (const char* name : {"n2.hdr.gz", "n2.img.gz", "n1.hdr.gz", "n1.img.gz"}) {
    Expect(dir_.Sub(name), 1, {-10, -20, 30}, {-6, -24.5, 33});
  }
  for (const char* name : {"a.hdr.gz", "a.img.gz", "half.hdr.gz", "half.img"}) {
    SCOPED_TRACE(name);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenVolumeFile(dir_.Sub(name)));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string samples, ReadAll(*volume, 1));
    EXPECT_EQ(samples, Volumes(1));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfVolume(dir_.Sub(name)));
    EXPECT_EQ(files.size(), 2u);
  }
  EXPECT_THAT(OpenVolumeFile(Write("alone.hdr.gz", Gzip(AnalyzeBytes({})))),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("alone.img")));
}

TEST_F(LayoutFormatsTest, Nifti2) {
  for (const bool is_big_endian : {false, true}) {
    const std::string samples = is_big_endian ? Swapped(Volumes(6), 2) : Volumes(6);
    const std::string header =
        Nifti2Bytes({.steps = 2, .components = 3, .is_big_endian = is_big_endian});
    Expect(Write("six.nii", header + samples), 6, kFirst, kLast);
    Expect(Write("six.nii.gz", Gzip(header + samples)), 6, kFirst, kLast);
    Expect(Write("anything", header + samples), 6, kFirst, kLast);
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(dir_.Sub("six.nii")));
  EXPECT_THAT(series->info().times, ElementsAre(0, 0.5));
  EXPECT_EQ(series->info().time_unit, "s");
  EXPECT_EQ(series->info().length_unit, "mm");
  EXPECT_THAT(series->info().fields[0].components, ElementsAre("x", "y", "z"));
  Expect(Write("one.nii", Nifti2Bytes({.slope = 2, .intercept = -1}) + Volumes(1)), 1, kFirst,
         kLast, 2, -1);
  Write("pair.img", Volumes(1));
  Expect(Write("pair.hdr", Nifti2Bytes({.is_pair = true})), 1, kFirst, kLast);
  Expect(dir_.Sub("pair.img"), 1, kFirst, kLast);
  EXPECT_THAT(FilesOfVolume(dir_.Sub("pair.img")).value(),
              ElementsAre(dir_.Sub("pair.hdr"), dir_.Sub("pair.img")));
}

// nibabel writes what numpy counts in, so label maps are often int64.
TEST_F(LayoutFormatsTest, NiftiOf64BitIntegersBecomesFloat64) {
  constexpr std::int64_t kLargest = std::int64_t{1} << 53;
  std::vector<std::int64_t> values;
  for (int i = 0; i < kSamples; ++i) {
    values.push_back(i - 5);
  }
  values.back() = kLargest;
  for (const std::int16_t datatype : {std::int16_t{1024}, std::int16_t{1280}}) {
    values.front() = datatype == 1024 ? -kLargest : 3;
    std::fill(values.begin() + 1, values.begin() + 6, 1);
    const std::string samples = BytesOf(values);
    const std::string first =
        testing::NiftiHeaderBytes({.dims = kDims, .datatype = datatype}) + samples;
    for (const std::string& path :
         {Write("one.nii", first), Write("one.nii.gz", Gzip(first)), Write("anything", first),
          Write("two.nii", Nifti2Bytes({.datatype = datatype}) + samples)}) {
      SCOPED_TRACE(path);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(path));
      ASSERT_EQ(source->info().type, volume::ScalarType::kFloat64);
      EXPECT_LT(math::Length(source->info().geometry.origin - kFirst), 1e-5);
      const auto read = ValuesOf<double>(ReadAll(*source, 1).value());
      EXPECT_THAT(read, ::testing::ElementsAreArray(values));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path));
      EXPECT_EQ(series->info().fields.size(), 1U);
    }
  }
  values.back() = kLargest + 1;
  EXPECT_THAT(Open(Write("far.nii", testing::NiftiHeaderBytes({.dims = kDims, .datatype = 1024}) +
                                        BytesOf(values))),
              StatusIs(kInvalid, HasSubstr("9007199254740993")));
  EXPECT_THAT(
      Open(Write("slope.nii", Nifti2Bytes({.datatype = 1024, .slope = 2}) + BytesOf(values))),
      StatusIs(kInvalid, HasSubstr("slope 2")));
  // The refusal of NIfTI-1 blamed the datatype.
  EXPECT_THAT(Open(Write("slope1.nii",
                         testing::NiftiHeaderBytes({.dims = kDims, .datatype = 1024, .slope = 2}) +
                             BytesOf(values))),
              StatusIs(kInvalid, AllOf(HasSubstr("64-bit integers"), HasSubstr("slope 2"))));
  EXPECT_THAT(Open(Write("rgb.nii", Nifti2Bytes({.datatype = 128}) + Volumes(2))),
              StatusIs(kInvalid, HasSubstr("128 (RGB colours)")));
}

TEST_F(LayoutFormatsTest, TransformsOfNifti2) {
  const auto write = [&](const testing::Nifti2Header& header) {
    return Write("t.nii", Nifti2Bytes(header) + Volumes(1));
  };
  Expect(write({.qform_code = 1, .sform_code = 0}), 1, kFirst, kLast);
  Expect(write({.qform_code = 1, .sform_code = 2, .shear = 0.5}), 1, kFirst, kLast);
  Expect(write({.units = 9}), 1, kFirst * 1000.0, kLast * 1000.0);  // metres
  // No transform: spacings alone, and no patient.
  Expect(write({.sform_code = 0}), 1, {0, 0, 0}, {-4.5, -4, 3});
  EXPECT_FALSE(OpenVolumeFile(dir_.Sub("t.nii")).value()->info().patient_frame.has_value());
  EXPECT_TRUE(OpenVolumeFile(write({})).value()->info().patient_frame.has_value());
  EXPECT_THAT(Open(write({.shear = 0.5})),
              StatusIs(kInvalid, AllOf(HasSubstr("axes x and y meet at 108.4 degrees"),
                                       HasSubstr("--ignore-shear"))));
}

// The flag takes a sheared header of each format; which grid it becomes is AdjustSource's.
TEST_F(LayoutFormatsTest, ShearIsTakenIfTheRulesIgnoreIt) {
  const auto write_nifti1 = [&](const std::string& name) {
    std::string header = testing::NiftiHeaderBytes({.dims = kDims});
    const float shear = 0.5F;
    std::memcpy(header.data() + 280, &shear, sizeof(shear));
    return Write(name, header + Volumes(1));
  };
  std::string mgh = MghBytes({});
  const float lean = 0.5F;  // along x of the first axis
  std::memcpy(mgh.data() + 42,
              Swapped(std::string(reinterpret_cast<const char*>(&lean), 4), 4).data(), 4);
  std::string afni = AfniBytes(1, "1", "0");
  Write("s.BRIK", Volumes(1));
  const std::size_t rows = afni.find("IJK_TO_DICOM_REAL");
  ASSERT_NE(rows, std::string::npos);
  afni.replace(afni.find("0 -2", rows), 4, "1 -2");
  for (const std::string& path :
       {write_nifti1("s.nii"), write_nifti1("anything"),
        Write("s.nii.gz", Gzip(testing::ReadFile(dir_.Sub("s.nii")))),
        Write("s2.nii", Nifti2Bytes({.shear = 0.5}) + Volumes(1)),
        Write("s.mgh", mgh + Swapped(Volumes(1), 2)), Write("s.HEAD", afni)}) {
    SCOPED_TRACE(path);
    EXPECT_THAT(Open(path), StatusIs(kInvalid, HasSubstr("--ignore-shear")));
    EXPECT_THAT(OpenVolumeFile(path).status(), StatusIs(kInvalid, HasSubstr("--ignore-shear")));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const auto series, OpenVolumeSeries(path, {.axes = "", .rules = {.ignores_shear = true}}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto of_series, series->Open(0, 0, 0));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source,
                                  OpenVolumeFile(path, "", {.ignores_shear = true}));
    EXPECT_EQ(source->info().geometry, of_series->info().geometry);
    EXPECT_TRUE(source->info().patient_frame.has_value());
    EXPECT_TRUE(FindShear(source->info().geometry.direction).has_value());
    EXPECT_EQ(ValuesOf<std::int16_t>(ReadAll(*source, 1).value()),
              ValuesOf<std::int16_t>(Volumes(1)));
    EXPECT_TRUE(FilesOfVolume(path, {.axes = "", .rules = {.ignores_shear = true}}).ok());
  }
  // RAS columns (0.5, 1.5, 0), (-2, 0, 0) and (0, 0, 3): the far corner.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto nifti,
                                OpenVolumeFile(dir_.Sub("s.nii"), "", {.ignores_shear = true}));
  EXPECT_LT(
      math::Length(math::TransformPoint(nifti->info().geometry.world_from_index(), {3, 2, 1}) -
                   math::Vec3d{-7.5, -24.5, 33}),
      1e-6);
}

TEST_F(LayoutFormatsTest, Analyze) {
  for (const bool is_big_endian : {false, true}) {
    Write("a.hdr", AnalyzeBytes({.steps = 2, .is_big_endian = is_big_endian}));
    Expect(Write("a.img", is_big_endian ? Swapped(Volumes(2), 2) : Volumes(2)), 2, {0, 0, 0},
           {4.5, 4, 3});
  }
  Write("b.img.gz", Gzip(Volumes(1)));
  Expect(Write("b.hdr", AnalyzeBytes({.factor = 0.5F})), 1, {0, 0, 0}, {4.5, 4, 3}, 0.5);
  EXPECT_FALSE(OpenVolumeFile(dir_.Sub("b.hdr")).value()->info().patient_frame.has_value());
  EXPECT_THAT(Open(Write("b.hdr", AnalyzeBytes({.datatype = 128}))),
              StatusIs(kInvalid, HasSubstr("datatype 128")));
}

TEST_F(LayoutFormatsTest, Mgh) {
  // The centre (10, 20, 30) is sample (2, 1.5, 1).
  const math::Vec3d first{-(10 + 3), -(20 - 3), 30 - 3};
  const math::Vec3d last{-(13 - 4), -(17 + 4.5), 27 + 3};
  const std::string samples = Swapped(Volumes(2), 2);
  Expect(Write("m.mgh", MghBytes({}) + samples), 1, first, last);
  Expect(Write("m.mgz", Gzip(MghBytes({.frames = 2}) + samples)), 2, first, last);
  Expect(Write("plain", MghBytes({.frames = 2}) + samples), 2, first, last);
  Expect(Write("u.mgh", MghBytes({.is_placed = false}) + samples), 1, {-2, 1, 1.5}, {1, 0, -0.5});
  EXPECT_FALSE(OpenVolumeFile(dir_.Sub("u.mgh")).value()->info().patient_frame.has_value());
  // The footer has the repetition time; that of a compressed file is not read.
  const std::string footer = Swapped(BytesOf(std::vector<float>{2500, 0.5F, 30, 0}), 4);
  const auto times = [](const std::string& path) {
    const auto series = OpenVolumeSeries(path).value();
    return absl::StrCat(absl::StrJoin(series->info().times, " "), " ", series->info().time_unit);
  };
  EXPECT_EQ(times(Write("m.mgh", MghBytes({.frames = 2}) + samples + footer)), "0 2500 ms");
  EXPECT_EQ(times(Write("m.mgh", MghBytes({.frames = 2}) + samples)), "0 1 ");
  EXPECT_EQ(times(Write("m.mgz", Gzip(MghBytes({.frames = 2}) + samples + footer))), "0 1 ");
  EXPECT_THAT(Open(Write("m.mgh", MghBytes({.type = 5}))), StatusIs(kInvalid, HasSubstr("type 5")));
  EXPECT_THAT(Open(Write("m.mgh", MghBytes({.frames = 0}))),
              StatusIs(kInvalid, HasSubstr("0 frames")));
}

TEST_F(LayoutFormatsTest, Afni) {
  const math::Vec3d first{10, 20, 30};  // LPS as it is
  const math::Vec3d last{6, 24.5, 33};
  Write("a+orig.BRIK", Volumes(1));
  Expect(Write("a+orig.HEAD", AfniBytes(1, "1", "0.5")), 1, first, last, 0.5);
  Write("b+tlrc.BRIK.gz", Gzip(Volumes(3)));
  Write("b+tlrc.HEAD", AfniBytes(3, "1 1 1", "0 0 0", AfniText("BRICK_LABS", "coef~t stat~coef")));
  Expect(dir_.Sub("b+tlrc.BRIK.gz"), 3, first, last);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto series, OpenVolumeSeries(dir_.Sub("b+tlrc.HEAD")));
  EXPECT_EQ(series->info().fields[0].name, "coef");
  EXPECT_EQ(series->info().fields[1].name, "t stat");
  EXPECT_EQ(series->info().fields[2].name, "coef#2");
  EXPECT_THAT(series->info().times, IsEmpty());
  Expect(Write("b+tlrc.HEAD", AfniBytes(3, "1 1 1", "0 0 0",
                                        AfniNumbers("TAXIS_NUMS", "3 0 77002", 3) +
                                            AfniNumbers("TAXIS_FLOATS", "0 2.5 0 0 0", 5))),
         3, first, last);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(series, OpenVolumeSeries(dir_.Sub("b+tlrc.HEAD")));
  EXPECT_THAT(series->info().times, ElementsAre(0, 2.5, 5));
  EXPECT_EQ(series->info().time_unit, "s");
  // The first time was taken as 0.
  const auto timed = [&](const std::string& floats) {
    return Write("b+tlrc.HEAD", AfniBytes(3, "1 1 1", "0 0 0",
                                          AfniNumbers("TAXIS_NUMS", "3 0 77002", 3) +
                                              AfniNumbers("TAXIS_FLOATS", floats, 5)));
  };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(series, OpenVolumeSeries(timed("10 2.5 0 0 0")));
  EXPECT_THAT(series->info().times, ElementsAre(10, 12.5, 15));
  EXPECT_THAT(OpenVolumeSeries(timed("nan 2.5 0 0 0")),
              StatusIs(kInvalid, HasSubstr("from the time nan on")));
}

TEST_F(LayoutFormatsTest, AfniOfOlderPrograms) {
  // Without IJK_TO_DICOM_REAL: x runs from left to right, y from inferior to superior.
  std::string head =
      AfniBytes(1, "1", "0",
                AfniNumbers("ORIGIN", "10 30 20", 3) + AfniNumbers("DELTA", "-1.5 2 3", 3) +
                    AfniNumbers("ORIENT_SPECIFIC", "1 4 3", 3));
  head.replace(head.find("IJK_TO_DICOM_REAL"), 17, "IJK_TO_DICOM_REAK");
  Write("o.BRIK", Volumes(1));
  Expect(Write("o.HEAD", head), 1, {10, 20, 30}, {5.5, 23, 34});
  head.replace(head.find("ORIGIN"), 6, "ORIGIM");
  EXPECT_THAT(Open(Write("o.HEAD", head)), StatusIs(kInvalid, HasSubstr("IJK_TO_DICOM_REAL")));
  EXPECT_THAT(Open(Write("o.HEAD", AfniBytes(2, "1 3", "0 0"))),
              StatusIs(kInvalid, AllOf(HasSubstr("1, 3"), HasSubstr("one type"))));
  EXPECT_THAT(Open(Write("gone.HEAD", AfniBytes(1, "1", "0"))),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("gone.BRIK")));
  EXPECT_THAT(Open(Write("o.HEAD", AfniNumbers("X", "1 2 3", 900000))),
              StatusIs(kInvalid, HasSubstr("900000")));
  EXPECT_THAT(Open(Write("o.HEAD", AfniNumbers("X", "1 zwei 3", 3))),
              StatusIs(kInvalid, HasSubstr("zwei")));
}

// The images of `count` volumes, which lie backwards in the REC file: the keys by volume.
std::string Images(const std::vector<testing::ParLine>& volumes) {
  std::string text;
  for (std::size_t v = 0; v < volumes.size(); ++v) {
    for (const int slice : {2, 1}) {
      testing::ParLine line = volumes[v];
      line.slice = slice;
      line.index = static_cast<int>(2 * v) + slice - 1;
      text += ParImage(line);
    }
  }
  return text;
}

TEST_F(LayoutFormatsTest, ParRec) {
  // Transverse: x to the left, y to posterior, z up; thickness and gap are 3 together.
  const math::Vec3d first{30 - 2.25, 10 - 2, 20 - 1.5};
  const math::Vec3d last{30 + 2.25, 10 + 2, 20 + 1.5};
  Write("p.REC", Volumes(4));
  Expect(Write("p.PAR", ParBytes(Images({{}}))), 1, first, last);
  Expect(dir_.Sub("p.REC"), 1, first, last);
  EXPECT_EQ(OpenVolumeSeries(dir_.Sub("p.REC")).value()->info().fields[0].name, "p");
  EXPECT_THAT(FilesOfVolume(dir_.Sub("p.REC")).value(),
              ElementsAre(dir_.Sub("p.PAR"), dir_.Sub("p.REC")));
  EXPECT_THAT(Open(Write("alone.REC", Volumes(4))), StatusIs(kInvalid, HasSubstr("unknown kind")));
  Expect(Write("p.PAR", ParBytes(Images({{.slope = 0.5, .intercept = 3}}))), 1, first, last, 0.5,
         3);
  Expect(Write("p.PAR", ParBytes(Images({{.dynamic = 1, .dynamic_time = 1},
                                         {.dynamic = 2, .dynamic_time = 3.5}}))),
         2, first, last);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto series, OpenVolumeSeries(dir_.Sub("p.PAR")));
  EXPECT_THAT(series->info().times, ElementsAre(1, 3.5));
  EXPECT_EQ(series->info().time_unit, "s");
  Expect(Write("p.PAR",
               ParBytes(Images(
                   {{.echo = 1}, {.echo = 2}, {.echo = 1, .type = 3}, {.echo = 2, .type = 3}}))),
         4, first, last);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(series, OpenVolumeSeries(dir_.Sub("p.PAR")));
  EXPECT_EQ(series->info().fields[1].name, "phase");
  EXPECT_THAT(series->info().times, ElementsAre(10, 20));
  EXPECT_EQ(series->info().time_unit, "ms");
  Expect(Write("p.PAR", ParBytes(Images({{.echo = 1, .dynamic = 1},
                                         {.echo = 1, .dynamic = 2},
                                         {.echo = 2, .dynamic = 1},
                                         {.echo = 2, .dynamic = 2}}))),
         4, first, last);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(series, OpenVolumeSeries(dir_.Sub("p.PAR")));
  EXPECT_EQ(series->info().fields[1].name, "magnitude echo 2");
  EXPECT_EQ(series->info().step_count(), 2);
}

TEST_F(LayoutFormatsTest, SequencesAndDiffusionOfParRec) {
  const math::Vec3d first{30 - 2.25, 10 - 2, 20 - 1.5};
  const math::Vec3d last{30 + 2.25, 10 + 2, 20 + 1.5};
  Write("p.REC", Volumes(4));
  Expect(Write("p.PAR", ParBytes(Images({{.type = 0, .sequence = 2}, {.type = 3, .sequence = 4}}))),
         2, first, last);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto series, OpenVolumeSeries(dir_.Sub("p.PAR")));
  EXPECT_EQ(series->info().fields[1].name, "phase");
  Expect(Write("p.PAR", ParBytes(Images({{.type = 0, .sequence = 2}, {.type = 0, .sequence = 4}}))),
         2, first, last);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(series, OpenVolumeSeries(dir_.Sub("p.PAR")));
  EXPECT_EQ(series->info().fields[1].name, "magnitude sequence 4");
  // Version 4 has no numbers of directions: those of one b factor follow each other.
  Expect(Write("p.PAR",
               ParBytes(Images(
                   {{.b_factor = 0}, {.b_factor = 800}, {.b_factor = 800}, {.b_factor = 800}}))),
         4, first, last);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(series, OpenVolumeSeries(dir_.Sub("p.PAR")));
  EXPECT_THAT(series->info().times, ElementsAre(0, 1, 2, 3));
}

TEST_F(LayoutFormatsTest, OrientationsOfParRec) {
  Write("p.REC", Volumes(1));
  // Sagittal: x to posterior, y down, z to the right. Coronal: x to the left, y down, z back.
  Expect(Write("p.PAR", ParBytes(Images({{.orientation = 2}}))), 1, {31.5, 7.75, 22},
         {28.5, 12.25, 18});
  Expect(Write("p.PAR", ParBytes(Images({{.orientation = 3}}))), 1, {27.75, 8.5, 22},
         {32.25, 11.5, 18});
  // A quarter of a turn about the axis that runs up.
  Expect(Write("p.PAR", ParBytes(Images({{}}), "0 90 0")), 1, {32, 7.75, 18.5}, {28, 12.25, 21.5});
}

TEST_F(LayoutFormatsTest, WhatIsNoPlainVolumeOfParRecIsRefusedWithItsNumbers) {
  Write("p.REC", Volumes(4));
  const auto error = [&](const std::string& images) {
    return Open(Write("p.PAR", ParBytes(images)));
  };
  EXPECT_THAT(
      error(Images({{.gap = 1}, {.dynamic = 2, .gap = 2}})),
      StatusIs(kInvalid, AllOf(HasSubstr("slice gap is 1"), HasSubstr("and 2 in another"))));
  EXPECT_THAT(error(Images({{}, {}})), StatusIs(kInvalid, HasSubstr("there twice")));
  EXPECT_THAT(error(Images({{}}) + ParImage({.slice = 1, .dynamic = 2})),
              StatusIs(kInvalid, HasSubstr("has 1 of 2 slices")));
  EXPECT_THAT(error(Images({{.echo = 1}, {.echo = 2}, {.echo = 1, .type = 3}})),
              StatusIs(kInvalid, HasSubstr("3 volumes of 2 types of images at 2 steps")));
  EXPECT_THAT(error(Images({{.orientation = 4}})), StatusIs(kInvalid, HasSubstr("orientation 4")));
  EXPECT_THAT(error("  1 2 3\n"), StatusIs(kInvalid, HasSubstr("3 columns")));
  EXPECT_THAT(error(""), StatusIs(kInvalid, HasSubstr("no line of an image")));
  EXPECT_THAT(error(ParImage({.slice = 1}) + ParImage({.slice = 2, .index = 99})),
              StatusIs(kInvalid, AllOf(HasSubstr("p.REC"), HasSubstr("2400"), HasSubstr("192"))));
  Write("gone.PAR", ParBytes(Images({{}})));
  EXPECT_THAT(Open(dir_.Sub("gone.PAR")),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("gone.REC")));
}

// Words that are no numbers were read as 0, which made slices of zeros.
TEST_F(LayoutFormatsTest, ColumnsOfParRecAreNumbers) {
  Write("p.REC", Volumes(4));
  const auto error = [&](const std::string& from, const std::string& to) {
    const std::string images = Images({{.slope = 7, .intercept = 9}});
    EXPECT_NE(images.find(from), std::string::npos) << from;
    return Open(Write("p.PAR", ParBytes(absl::StrReplaceAll(images, {{from, to}}))));
  };
  ISOSCOPE_EXPECT_OK(error(" 9 7 0.004", " 9 7 0.004"));
  for (const char* bad : {"1e", "nan", "inf", "x"}) {
    EXPECT_THAT(error(" 7 0.004", absl::StrCat(" ", bad, " 0.004")),
                StatusIs(kInvalid, AllOf(HasSubstr("line 1 of images"), HasSubstr("rescale slope"),
                                         HasSubstr(bad))));
    EXPECT_THAT(error(" 9 7 ", absl::StrCat(" ", bad, " 7 ")),
                StatusIs(kInvalid, HasSubstr("rescale intercept")));
  }
  EXPECT_THAT(error(" 7 0.004", " 0.0 0.004"), StatusIs(kInvalid, HasSubstr("rescale slope 0")));
  // A column that is not read may hold a text.
  ISOSCOPE_EXPECT_OK(error(" 0.004 ", " text "));
  for (const char* bad : {"nan", "inf"}) {
    EXPECT_THAT(error(" 2.000 1 ", absl::StrCat(" 2.000 ", bad, " ")),
                StatusIs(kInvalid, AllOf(HasSubstr("slice gap"), HasSubstr("--spacing X,Y,Z"))));
  }
}

TEST_F(LayoutFormatsTest, SlicesOfParRecAreOneStack) {
  Write("p.REC", Volumes(4));
  const auto open = [&](const std::string& images) {
    return Open(Write("p.PAR", ParBytes(images)));
  };
  // All slices at one place of the REC file.
  EXPECT_THAT(open(ParImage({.slice = 1}) + ParImage({.slice = 2})),
              StatusIs(kInvalid, HasSubstr("slice 2 has index 0 in the REC file")));
  const auto image = [](int slice, const std::string& angles, const std::string& centre,
                        int dynamic = 1) {
    return absl::StrReplaceAll(
        ParImage({.slice = slice, .dynamic = dynamic, .index = 4 * dynamic + slice - 5}),
        {{" 1860  0 0 0  0 0 0 ", absl::StrCat(" 1860  ", angles, "  ", centre, " ")}});
  };
  const auto stack = [&](const std::string& angles, const std::string& centre, int dynamic = 1) {
    return image(1, "0 5 0", "0 0 0", dynamic) + image(2, "0 5 0", "0 3 0.01", dynamic) +
           image(3, angles, "0 6 0", dynamic) + image(4, "0 5 0", centre, dynamic);
  };
  ISOSCOPE_EXPECT_OK(open(stack("0 5 0", "0 9 0")));
  EXPECT_THAT(
      open(stack("0 5 7", "0 9 0")),
      StatusIs(kInvalid, AllOf(HasSubstr("0, 5, 0 degrees"), HasSubstr("slice 3 by 0, 5, 7"),
                               HasSubstr("export one stack alone"))));
  EXPECT_THAT(
      open(stack("0 5 0", "0 16 0")),
      StatusIs(kInvalid, AllOf(HasSubstr("the centre of slice 2"), HasSubstr("offcentre"))));
  // A second volume elsewhere.
  ISOSCOPE_EXPECT_OK(open(stack("0 5 0", "0 9 0") + stack("0 5 0", "0 9 0", 2)));
  EXPECT_THAT(open(stack("0 5 0", "0 9 0") + stack("0 5 0", "7 9 0", 2)),
              StatusIs(kInvalid, HasSubstr("the centre of slice 4 is at 7, 9, 0 mm")));
}

TEST_F(LayoutFormatsTest, HeadersOfTextInAGzipStreamAreNamedAsSuch) {
  Write("g.BRIK", Volumes(1));
  Write("g.REC", Volumes(1));
  EXPECT_THAT(Open(Write("g.HEAD", Gzip(AfniBytes(1, "1", "0")))),
              StatusIs(kInvalid, AllOf(HasSubstr("g.HEAD"), HasSubstr("gzip stream"))));
  EXPECT_THAT(Open(Write("g.PAR", Gzip(ParBytes(Images({{}}))))),
              StatusIs(kInvalid, AllOf(HasSubstr("g.PAR"), HasSubstr("gzip stream"))));
}

TEST_F(LayoutFormatsTest, CutFilesAreErrors) {
  const std::string mgh = MghBytes({}) + Swapped(Volumes(1), 2);
  const std::string nifti = Nifti2Bytes({}) + Volumes(1);
  for (const std::string& whole : {mgh, nifti}) {
    const std::string name = whole == mgh ? "c.mgh" : "c.nii";
    for (std::size_t size = 0; size < whole.size(); size += 1 + size / 9) {
      EXPECT_FALSE(Open(Write(name, whole.substr(0, size))).ok()) << name << size;
      EXPECT_FALSE(Open(Write("c.mgz", Gzip(whole).substr(0, size / 8))).ok()) << name << size;
    }
  }
  EXPECT_THAT(Open(Write("c.mgh", mgh.substr(0, mgh.size() - 1))),
              StatusIs(kInvalid, AllOf(HasSubstr("332"), HasSubstr("331"))));
  const std::string head = AfniBytes(1, "1", "0.5");
  Write("c.BRIK", Volumes(1));
  for (std::size_t size = 0; size < head.size(); size += 7) {
    Open(Write("c.HEAD", head.substr(0, size))).IgnoreError();  // no crash
  }
  const std::string par = ParBytes(Images({{}}));
  Write("c.REC", Volumes(1));
  for (std::size_t size = 0; size + 200 < par.size(); size += 7) {
    EXPECT_FALSE(Open(Write("c.PAR", par.substr(0, size))).ok()) << size;
  }
}

}  // namespace
}  // namespace isoscope::source
