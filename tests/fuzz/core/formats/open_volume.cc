#include "tests/fuzz/core/formats/open_volume.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <memory>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"

#include "core/base/cancellation.h"
#include "core/formats/open_volume.h"
#include "core/source/volume_series.h"
#include "core/source/volume_source.h"
#include "core/volume/grid_geometry.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/support/only_volume.h"
#include "tests/support/temp_dir.h"

namespace isoscope::fuzz {
namespace {

constexpr std::int64_t kMaxReadBytes = std::int64_t{1} << 20;

void RequireSourceError(const absl::Status& status) {
  using absl::StatusCode;
  RequireError(status, {StatusCode::kNotFound, StatusCode::kInvalidArgument, StatusCode::kDataLoss,
                        StatusCode::kFailedPrecondition, StatusCode::kPermissionDenied,
                        StatusCode::kResourceExhausted});
}

// All samples, `rows` rows at a time.
absl::StatusOr<std::string> ReadSamples(source::VolumeSource* volume, std::int64_t rows) {
  const math::Index3& dims = volume->info().geometry.sample_dims;
  const std::int64_t row_bytes =
      dims.x * static_cast<std::int64_t>(volume::SizeOf(volume->info().type));
  const std::int64_t row_count = dims.y * dims.z;
  std::string samples;
  for (std::int64_t begin = 0; begin < row_count; begin += rows) {
    const std::int64_t end = std::min(begin + rows, row_count);
    // Exactly as large, so that a sanitizer sees what is written beyond it.
    const auto run_bytes = static_cast<std::size_t>((end - begin) * row_bytes);
    const auto run = std::make_unique<char[]>(run_bytes);
    const absl::Status status = volume->ReadRows(begin, end, run.get());
    if (!status.ok()) {
      return status;
    }
    samples.append(run.get(), run_bytes);
  }
  return samples;
}

// The volume as a box, if it has boxes: samples of rows, or an error.
void ReadBoxes(const source::VolumeSource& volume, const absl::StatusOr<std::string>& whole) {
  const math::Index3& dims = volume.info().geometry.sample_dims;
  if (!volume.box_grid().has_value()) {
    return;
  }
  const auto size = static_cast<std::size_t>(dims.y * dims.z * volume.info().row_bytes());
  const auto box = std::make_unique<char[]>(size);
  const absl::Status status =
      volume.ReadBox({.begin = {0, 0, 0}, .end = dims}, box.get(), base::Cancellation());
  if (!status.ok()) {
    RequireSourceError(status);
    return;
  }
  Require(!whole.ok() || *whole == std::string(box.get(), size), "a box has the samples of rows");
}

void ReadVolume(source::VolumeSource* volume) {
  const math::Index3& dims = volume->info().geometry.sample_dims;
  const auto sample_bytes = static_cast<std::int64_t>(volume::SizeOf(volume->info().type));
  if (math::Volume(dims) > kMaxReadBytes / sample_bytes) {
    return;
  }
  const auto whole = ReadSamples(volume, dims.y * dims.z);
  if (!whole.ok()) {
    RequireSourceError(whole.status());
    ReadBoxes(*volume, whole);
    Require(!ReadSamples(volume, dims.y * dims.z).ok(), "what can't be read can't be read again");
    return;
  }
  const auto again = ReadSamples(volume, dims.y * dims.z);
  Require(again.ok() && *again == *whole, "a volume that is read again is the same");
  ReadBoxes(*volume, whole);
  const auto in_runs = ReadSamples(volume, 1 + dims.y / 2);
  Require(in_runs.ok() && *in_runs == *whole, "a volume is the same in one piece and in several");
}

void CheckVolume(const absl::StatusOr<std::unique_ptr<source::VolumeSource>>& volume) {
  if (!volume.ok()) {
    RequireSourceError(volume.status());
    return;
  }
  Require(volume::Validate((*volume)->info().geometry).ok(), "an open volume has a valid grid");
  Require((*volume)->info().memory_bytes >= 0, "memory is no negative number");
  ReadVolume(volume->get());
}

}  // namespace

const std::string& VolumeFolder() {
  static const testing::TempDir folder;
  return folder.path();
}

std::string InVolumeFolder(absl::string_view name) {
  return absl::StrCat(VolumeFolder(), "/", name);
}

void WriteVolumeFile(absl::string_view name, absl::string_view bytes) {
  std::ofstream file(InVolumeFolder(name), std::ios::binary | std::ios::trunc);
  file.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  Require(file.flush().good(), "the folder of the inputs has room");
}

std::string ReadVolumeFile(absl::string_view name) {
  std::ifstream file(InVolumeFolder(name), std::ios::binary);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

void OpenAndReadVolume(const std::string& path) {
  const auto files = source::FilesOfVolume(path);
  Require(!files.ok() || !files->empty(), "a volume has files");
  CheckVolume(source::OpenVolumeFile(path));
}

void OpenAndReadSeries(const std::string& path) {
  OpenAndReadVolume(path);
  const auto series = source::OpenVolumeSeries(path);
  if (!series.ok()) {
    RequireSourceError(series.status());
    return;
  }
  constexpr std::size_t kMaxFields = 3;
  const std::size_t fields = std::min((*series)->info().fields.size(), kMaxFields);
  Require(fields > 0, "a series has a field");
  for (std::size_t field = 0; field < fields; ++field) {
    const auto components = static_cast<int>((*series)->info().fields[field].components.size());
    Require(components > 0, "a field has a component");
    for (const int component : {0, components - 1}) {
      for (const int step : {0, (*series)->info().step_count() - 1}) {
        CheckVolume((*series)->Open(static_cast<int>(field), component, step));
      }
    }
  }
}

}  // namespace isoscope::fuzz
