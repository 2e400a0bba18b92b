#include "core/synthetic/volume_file.h"

#include <csignal>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "oneapi/tbb/global_control.h"
#include <sys/resource.h>

#include "core/formats/source_labels.h"
#include "core/io/file.h"
#include "core/source/volume_source.h"
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
using ::testing::_;
using ::testing::HasSubstr;
using volume::ScalarType;

class VolumeFileTest : public ::testing::Test {
 protected:
  static std::unique_ptr<VolumeGenerator> Generator(ScalarType type,
                                                    const math::Index3& dims = {20, 11, 9}) {
    auto generator =
        VolumeGenerator::Make({.field = GeneratedField::kRandom, .wave_count = 8}, dims, type);
    EXPECT_THAT(generator.status(), testing::IsOk());
    return *std::move(generator);
  }
  static std::string SamplesOf(const VolumeGenerator& generator) {
    std::string samples(
        static_cast<std::size_t>(math::Volume(generator.dims())) * volume::SizeOf(generator.type()),
        '\0');
    generator.FillRows(0, generator.row_count(), samples.data());
    return samples;
  }
  std::size_t EntryCount() const {
    std::size_t count = 0;
    for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator(dir_.path())) {
      ++count;
    }
    return count;
  }

  TempDir dir_;
  base::Cancellation never_;
};

TEST_F(VolumeFileTest, EveryKindAndTypeComesBackAsItWasGenerated) {
  for (const char* ending : {".nrrd", ".nhdr", ".mha"}) {
    for (const ScalarType type :
         {ScalarType::kUint8, ScalarType::kInt8, ScalarType::kUint16, ScalarType::kInt16,
          ScalarType::kUint32, ScalarType::kInt32, ScalarType::kFloat32, ScalarType::kFloat64}) {
      SCOPED_TRACE(absl::StrCat(ending, " ", std::string(volume::NameOf(type))));
      const auto generator = Generator(type);
      VolumeFileOptions options{.path = dir_.Sub(absl::StrCat("v", ending)),
                                .spacing = {0.1, 1.0 / 3, 7},
                                .origin = {-1.5, 2e-7, 3}};
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::int64_t bytes,
                                    WriteVolumeFile(*generator, options, never_));
      EXPECT_EQ(bytes, static_cast<std::int64_t>(20 * 11 * 9 * volume::SizeOf(type)));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(options.path));
      EXPECT_EQ(source->info().type, type);
      EXPECT_EQ(source->info().geometry.sample_dims, generator->dims());
      for (int axis = 0; axis < 3; ++axis) {
        EXPECT_DOUBLE_EQ(source->info().geometry.spacing[axis], options.spacing[axis]);
        EXPECT_DOUBLE_EQ(source->info().geometry.origin[axis], options.origin[axis]);
      }
      EXPECT_EQ(source->info().geometry.direction, math::Mat3d{});
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string samples, ReadAll(*source, 4));
      EXPECT_TRUE(samples == SamplesOf(*generator));
    }
  }
}

TEST_F(VolumeFileTest, NamesAndColoursOfLabelsComeBackFromNrrd) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto generator,
      VolumeGenerator::Make({.field = GeneratedField::kLabels, .region_count = 100}, {20, 11, 9},
                            ScalarType::kUint8));
  for (const char* ending : {".nrrd", ".nhdr", ".mha"}) {
    const std::string path = dir_.Sub(absl::StrCat("v", ending));
    ISOSCOPE_ASSERT_OK(WriteVolumeFile(*generator, {.path = path}, never_).status());
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<volume::Label> labels, ReadSourceLabels(path));
    EXPECT_EQ(labels,
              ending == std::string(".mha") ? std::vector<volume::Label>() : generator->labels())
        << ending;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(path));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string samples, ReadAll(*source, 4));
    EXPECT_TRUE(samples == SamplesOf(*generator)) << ending;
  }
}

TEST_F(VolumeFileTest, RawFileIsTheSamplesAlone) {
  const auto generator = Generator(ScalarType::kInt16);
  ISOSCOPE_ASSERT_OK(WriteVolumeFile(*generator, {.path = dir_.Sub("v.raw")}, never_).status());
  EXPECT_TRUE(ReadFile(dir_.Sub("v.raw")) == SamplesOf(*generator));
  EXPECT_EQ(EntryCount(), 1u);
}

TEST_F(VolumeFileTest, BytesAreTheSameForEveryNumberOfThreads) {
  // Several chunks of 2 MiB.
  const auto generator = Generator(ScalarType::kFloat64, {128, 100, 60});
  const std::string expected = SamplesOf(*generator);
  for (const std::size_t threads : {1u, 2u, 5u}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    const std::string path = dir_.Sub(absl::StrCat("v", threads, ".raw"));
    std::int64_t last = 0;
    ISOSCOPE_ASSERT_OK(WriteVolumeFile(*generator,
                                       {.path = path,
                                        .progress =
                                            [&](std::int64_t done, std::int64_t total) {
                                              EXPECT_GT(done, last);
                                              EXPECT_EQ(total, std::int64_t{128 * 100 * 60 * 8});
                                              last = done;
                                            }},
                                       never_)
                           .status());
    EXPECT_EQ(last, std::int64_t{128 * 100 * 60 * 8});
    EXPECT_TRUE(ReadFile(path) == expected) << threads;
  }
}

TEST_F(VolumeFileTest, FileOfThatNameIsReplacedOnlyWhenTheNewOneIsWhole) {
  const auto generator = Generator(ScalarType::kUint8, {128, 128, 400});
  testing::WriteFile(dir_.Sub("v.raw"), "old");
  base::Cancellation cancellation;
  EXPECT_THAT(
      WriteVolumeFile(*generator,
                      {.path = dir_.Sub("v.raw"),
                       .progress = [&](std::int64_t, std::int64_t) { cancellation.Cancel(); }},
                      cancellation)
          .status(),
      StatusIs(absl::StatusCode::kCancelled, _));
  EXPECT_EQ(ReadFile(dir_.Sub("v.raw")), "old");
  EXPECT_EQ(EntryCount(), 1u);
  ISOSCOPE_ASSERT_OK(WriteVolumeFile(*generator, {.path = dir_.Sub("v.raw")}, never_).status());
  EXPECT_TRUE(ReadFile(dir_.Sub("v.raw")) == SamplesOf(*generator));
  EXPECT_EQ(EntryCount(), 1u);
}

TEST_F(VolumeFileTest, CancellationAndFullDiskLeaveNothingOfEitherFile) {
  const auto generator = Generator(ScalarType::kUint8, {128, 128, 400});
  for (const char* ending : {".nrrd", ".nhdr", ".mha", ".raw"}) {
    base::Cancellation cancelled;
    cancelled.Cancel();
    const VolumeFileOptions options{.path = dir_.Sub(absl::StrCat("v", ending))};
    EXPECT_THAT(WriteVolumeFile(*generator, options, cancelled).status(),
                StatusIs(absl::StatusCode::kCancelled, _));
    EXPECT_EQ(EntryCount(), 0u);

    rlimit before{};
    ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
    const auto old_handler = std::signal(SIGXFSZ, SIG_IGN);
    rlimit small = before;
    small.rlim_cur = 3000000;
    ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
    const absl::Status status = WriteVolumeFile(*generator, options, never_).status();
    ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &before), 0);
    std::signal(SIGXFSZ, old_handler);
    EXPECT_THAT(status, StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("v.")));
    EXPECT_EQ(EntryCount(), 0u) << ending;
  }
}

TEST_F(VolumeFileTest, VolumeThatTheDiskCantHoldIsRefusedBeforeItIsBegun) {
  // 2^57 bytes.
  const auto generator = Generator(ScalarType::kFloat64, {1 << 18, 1 << 18, 1 << 18});
  EXPECT_THAT(WriteVolumeFile(*generator, {.path = dir_.Sub("huge.nrrd")}, never_).status(),
              StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("144115188075855872")));
  EXPECT_EQ(EntryCount(), 0u);
}

TEST_F(VolumeFileTest, BadNamesAndPlacesAreRefused) {
  const auto generator = Generator(ScalarType::kUint8);
  const auto status_of = [&](const std::string& name) {
    return WriteVolumeFile(*generator, {.path = dir_.Sub(name)}, never_).status();
  };
  EXPECT_THAT(status_of("v.nii"), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(".mha")));
  EXPECT_THAT(status_of("v"), StatusIs(absl::StatusCode::kInvalidArgument, _));
  EXPECT_THAT(status_of("absent/v.raw"), StatusIs(absl::StatusCode::kNotFound, _));
  std::filesystem::create_directory(dir_.Sub("folder.raw"));
  EXPECT_THAT(status_of("folder.raw"), StatusIs(absl::StatusCode::kFailedPrecondition, _));
  EXPECT_EQ(EntryCount(), 1u);
}

}  // namespace
}  // namespace isoscope::source
