#include "core/source/file_source.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <type_traits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/log.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "core/source/byte_order.h"
#include "core/source/inflate_reader.h"

namespace isoscope::source {
namespace {

// What an InflateReader holds, with its scratch space.
constexpr std::int64_t kInflaterBytes = 512 * base::kKiB;

bool IsRescaled(const SampleLocation& location) {
  return location.slope != 1 || location.intercept != 0;
}

// float32 where it holds every stored value, as ITK does; else float64, where ITK rounds.
volume::ScalarType RescaledType(volume::ScalarType stored) {
  switch (stored) {
    case volume::ScalarType::kUint32:
    case volume::ScalarType::kInt32:
    case volume::ScalarType::kFloat64:
      return volume::ScalarType::kFloat64;
    default:
      return volume::ScalarType::kFloat32;
  }
}

// `in` may lie in the tail of `out`: no sample is written over before it was read.
template <typename Out, typename In>
void Rescale(std::size_t count, double slope, double intercept, const char* in, char* out) {
  for (std::size_t i = 0; i < count; ++i) {
    const auto stored = static_cast<double>(base::LoadLittleEndian<In>(in + i * sizeof(In)));
    base::StoreLittleEndian(static_cast<Out>(stored * slope + intercept), out + i * sizeof(Out));
  }
}

class FileSource final : public VolumeSource {
 public:
  FileSource(const volume::GridGeometry& geometry, SampleLocation location, std::string name,
             std::unique_ptr<io::RandomAccessFile> file)
      : geometry_(geometry),
        type_(IsRescaled(location) ? RescaledType(location.stored_type) : location.stored_type),
        location_(std::move(location)),
        name_(std::move(name)),
        file_(std::move(file)) {
    if (location_.is_compressed) {
      inflater_ = std::make_unique<InflateReader>(file_.get(), location_.offset);
    }
  }

  [[nodiscard]] const volume::GridGeometry& geometry() const override { return geometry_; }
  [[nodiscard]] volume::ScalarType scalar_type() const override { return type_; }
  [[nodiscard]] const std::string& name() const override { return name_; }

  [[nodiscard]] bool is_seekable() const override { return !location_.is_compressed; }
  [[nodiscard]] std::int64_t memory_bytes() const override {
    return location_.is_compressed ? kInflaterBytes : 0;
  }

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    const math::Index3& dims = geometry_.sample_dims;
    const std::int64_t row_count = dims.y * dims.z;
    ISOSCOPE_CHECK(begin_row >= 0 && begin_row < end_row && end_row <= row_count);
    const auto stored_size = static_cast<std::int64_t>(volume::SizeOf(location_.stored_type));
    const std::int64_t row_bytes = dims.x * stored_size;
    const std::int64_t begin = begin_row * row_bytes;
    const auto size = static_cast<std::size_t>((end_row - begin_row) * row_bytes);
    const std::size_t count = size / static_cast<std::size_t>(stored_size);
    char* stored = out + count * volume::SizeOf(type_) - size;
    if (location_.is_compressed) {
      ISOSCOPE_RETURN_IF_ERROR(Inflate(begin, size, row_count * row_bytes, stored));
    } else {
      ISOSCOPE_RETURN_IF_ERROR(file_->ReadAt(location_.offset + begin, size, stored));
    }
    if (location_.is_big_endian) {
      SwapBytes(static_cast<std::size_t>(stored_size), count, stored);
    }
    if (IsRescaled(location_)) {
      RescaleSamples(count, stored, out);
    }
    return absl::OkStatus();
  }

 private:
  absl::Status Inflate(std::int64_t begin, std::size_t size, std::int64_t total_size, char* out) {
    const std::int64_t position = location_.decoded_skip + begin;
    if (position < inflater_->position()) {
      inflater_->Rewind();
    }
    ISOSCOPE_RETURN_IF_ERROR(inflater_->Skip(position - inflater_->position()).status());
    std::size_t got = 0;
    if (inflater_->position() == position) {
      ISOSCOPE_ASSIGN_OR_RETURN(got, inflater_->Read(size, out));
    }
    if (got < size) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: the header promises %d bytes of samples, the compressed data (%d bytes of file) "
          "ends after %d: the file is cut; copy it again",
          location_.path, total_size, file_->size_bytes(),
          std::max<std::int64_t>(inflater_->position() - location_.decoded_skip, 0)));
    }
    if (begin + static_cast<std::int64_t>(size) == total_size) {
      return inflater_->VerifyEnd();
    }
    return absl::OkStatus();
  }

  void RescaleSamples(std::size_t count, const char* stored, char* out) const {
    volume::VisitScalarType(location_.stored_type, [&]<typename In>() {
      if (type_ == volume::ScalarType::kFloat32) {
        Rescale<float, In>(count, location_.slope, location_.intercept, stored, out);
      } else {
        Rescale<double, In>(count, location_.slope, location_.intercept, stored, out);
      }
    });
  }

  const volume::GridGeometry geometry_;
  const volume::ScalarType type_;
  const SampleLocation location_;
  const std::string name_;
  const std::unique_ptr<io::RandomAccessFile> file_;
  std::unique_ptr<InflateReader> inflater_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSource>> MakeFileSource(const volume::GridGeometry& geometry,
                                                             const SampleLocation& location,
                                                             const std::string& name) {
  const absl::Status valid = volume::Validate(geometry);
  if (!valid.ok()) {
    return absl::Status(valid.code(), absl::StrCat(name, ": ", valid.message()));
  }
  const std::int64_t sample_count = math::Volume(geometry.sample_dims);
  const auto stored_size = static_cast<std::int64_t>(volume::SizeOf(location.stored_type));
  if (sample_count > std::numeric_limits<std::int64_t>::max() / 16) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %d samples: more than any file holds", name, sample_count));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<io::RandomAccessFile> file,
                            io::OpenRandomAccessFile(location.path));
  SampleLocation resolved = location;
  if (!location.is_compressed) {
    const std::int64_t sample_bytes = sample_count * stored_size;
    const std::int64_t file_size = file->size_bytes();
    if (location.at_file_end) {
      resolved.offset = std::max<std::int64_t>(file_size - sample_bytes, 0);
    }
    if (resolved.offset > file_size || file_size - resolved.offset < sample_bytes) {
      const math::Index3& dims = geometry.sample_dims;
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: %d x %d x %d samples of %s after %d header bytes need %d bytes, the file has %d",
          location.path, dims.x, dims.y, dims.z, volume::NameOf(location.stored_type),
          resolved.offset, resolved.offset + sample_bytes, file_size));
    }
    if (file_size - resolved.offset > sample_bytes) {
      base::LogWarning("trailing_bytes_ignored",
                       {{"file", location.path},
                        {"expected_bytes", resolved.offset + sample_bytes},
                        {"found_bytes", file_size}});
    }
  }
  return std::make_unique<FileSource>(geometry, std::move(resolved), name, std::move(file));
}

}  // namespace isoscope::source
