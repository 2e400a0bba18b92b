// Reading rows takes up to four steps:
//
// 1. StoredBytes::Read finds the file of the first byte, opens it, and reads or decodes up to the
//    end of that file; then it goes on with the next file.
// 2. Big-endian samples are swapped in place.
// 3. With a slope or an intercept, samples are widened: the stored ones are read into the tail of
//    the output, and rescaled from front to back (rescale.h).
//
// A box is read row by row (box_rows.h) by a reader of its own. Of a file at an address, the rows of
// many planes are fetched together, before they are read one by one.
//
// An encoded file can only be read forwards. Reading before its position starts it over, so such
// a source is not seekable. CheckFiles compares sizes at the start, where files show them.

#include "core/source/bytes/file_source.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/log.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "core/io/mounted_file.h"
#include "core/source/adapt/rescale.h"
#include "core/source/bytes/box_rows.h"
#include "core/source/bytes/byte_order.h"
#include "core/source/bytes/decoded_stream.h"
#include "core/source/bytes/file_content.h"
#include "core/source/bytes/zip_file.h"

namespace isoscope::source {
namespace {

// The tuples read at once to pick one component; more only if a single tuple is larger.
constexpr std::int64_t kStoredTupleBytes = 64 * base::kKiB;

// Of stretches at an address that are fetched together.
constexpr std::int64_t kFetchedBytes = base::kMiB;

// The bytes that may stand before samples at the end of an encoded file, which are decoded to find
// out.
constexpr std::int64_t kMaxSkipBytes = base::kGiB;

bool IsRescaled(const SampleLocation& location) {
  return location.is_always_rescaled || location.slope != 1 || location.intercept != 0;
}

// The samples' bytes as they are stored, in one or several files. Holds one of them open.
class StoredBytes {
 public:
  // `size` bytes in all.
  StoredBytes(SampleLocation location, std::int64_t size)
      : location_(std::move(location)),
        bytes_per_file_(size / static_cast<std::int64_t>(location_.files.size())) {}

  [[nodiscard]] const SampleLocation& location() const { return location_; }
  // Returns a reader of the same bytes that has no file open.
  [[nodiscard]] StoredBytes Again() const {
    return {location_, bytes_per_file_ * static_cast<std::int64_t>(location_.files.size())};
  }

  // INVALID_ARGUMENT if an uncompressed file is too short.
  absl::Status CheckFiles(const volume::GridGeometry& geometry);

  // Whether the samples are at an address.
  [[nodiscard]] bool is_far() const { return io::IsMounted(location_.files.front()); }

  // A stretch of bytes as of Read.
  struct Stretch {
    std::int64_t begin = 0;
    std::size_t size = 0;
  };
  // Fetches stretches from an address, all at once; Read finds them until the next call. Leaves to
  // Read those that it can't fetch so. REQUIRES: they are ascending; no sample is encoded.
  absl::Status Fetch(const std::vector<Stretch>& stretches,
                     const base::Cancellation& cancellation) {
    fetched_.clear();
    fetched_.reserve(stretches.size());  // ranges point into it
    for (std::size_t first = 0; first < stretches.size();) {
      const auto file = static_cast<std::size_t>(stretches[first].begin / bytes_per_file_);
      ISOSCOPE_RETURN_IF_ERROR(Open(file));
      const std::optional<io::MountedFile> mounted = io::FindMounted(location_.files[file]);
      if (!mounted.has_value() || mounted->read_pieces == nullptr) {
        fetched_.clear();
        return absl::OkStatus();
      }
      std::vector<io::FilePiece> pieces;
      std::size_t last = first;
      for (; last < stretches.size() &&
             stretches[last].begin / bytes_per_file_ == static_cast<std::int64_t>(file);
           ++last) {
        const auto [begin, size] = stretches[last];
        const std::int64_t within = begin % bytes_per_file_;
        if (within + static_cast<std::int64_t>(size) <= bytes_per_file_) {  // not of two files
          fetched_.push_back({.begin = begin, .bytes = std::string(size, '\0')});
          pieces.push_back({.range = {.offset = offset() + within, .size = size},
                            .out = fetched_.back().bytes.data()});
        }
      }
      ISOSCOPE_RETURN_IF_ERROR(mounted->read_pieces(pieces, cancellation));
      first = last;
    }
    return absl::OkStatus();
  }

  // Bytes [begin, begin + size).
  absl::Status Read(std::int64_t begin, std::size_t size, char* out) {
    if (const char* const fetched = FindFetched(begin, size); fetched != nullptr) {
      std::copy_n(fetched, size, out);
      return absl::OkStatus();
    }
    while (size > 0) {
      ISOSCOPE_RETURN_IF_ERROR(Open(static_cast<std::size_t>(begin / bytes_per_file_)));
      const std::int64_t within = begin % bytes_per_file_;
      const std::size_t take = std::min(size, static_cast<std::size_t>(bytes_per_file_ - within));
      ISOSCOPE_RETURN_IF_ERROR(location_.is_encoded()
                                   ? Decode(within, take, out)
                                   : file_->ReadAt(offset() + within, take, out));
      begin += static_cast<std::int64_t>(take);
      size -= take;
      out += take;
    }
    return absl::OkStatus();
  }

 private:
  struct Fetched {
    std::int64_t begin = 0;
    std::string bytes;
  };

  // Null: they were not fetched.
  [[nodiscard]] const char* FindFetched(std::int64_t begin, std::size_t size) const {
    const auto behind = std::upper_bound(
        fetched_.begin(), fetched_.end(), begin,
        [](std::int64_t at, const Fetched& fetched) { return at < fetched.begin; });
    if (behind == fetched_.begin()) {
      return nullptr;
    }
    const Fetched& fetched = *std::prev(behind);
    const auto within = static_cast<std::size_t>(begin - fetched.begin);
    return within + size <= fetched.bytes.size() ? fetched.bytes.data() + within : nullptr;
  }

  absl::Status Open(std::size_t index) {
    if (file_ != nullptr && index == open_index_) {
      return absl::OkStatus();
    }
    stream_ = nullptr;  // released before its file
    file_ = nullptr;
    ISOSCOPE_ASSIGN_OR_RETURN(file_, io::OpenRandomAccessFile(location_.files[index]));
    open_index_ = index;
    return CheckIsNoLfsPointer(*file_);
  }

  // Returns the offset of the first sample in the open file.
  [[nodiscard]] std::int64_t offset() const {
    return location_.at_file_end ? std::max<std::int64_t>(file_->size_bytes() - bytes_per_file_, 0)
                                 : location_.offset;
  }

  // Decodes `size` bytes from `begin` of the open file's samples.
  absl::Status Decode(std::int64_t begin, std::size_t size, char* out) {
    if (stream_ == nullptr) {
      stream_ = location_.encoding == SampleEncoding::kZip
                    ? MakeZipStream(location_.member, file_.get())
                    : MakeDecodedStream(location_.encoding, location_.stored_type, file_.get(),
                                        location_.offset);
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t skip, DecodedSkip());
    const std::int64_t position = skip + begin;
    if (position < stream_->position()) {
      stream_->Rewind();
    }
    ISOSCOPE_RETURN_IF_ERROR(stream_->Skip(position - stream_->position()).status());
    std::size_t got = 0;
    if (stream_->position() == position) {
      ISOSCOPE_ASSIGN_OR_RETURN(got, stream_->Read(size, out));
    }
    if (got < size) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: the header promises %d bytes of samples, the %s (%d bytes of file) ends after %d: "
          "the file is cut; copy it again",
          file_->path(), bytes_per_file_,
          location_.encoding == SampleEncoding::kText || location_.encoding == SampleEncoding::kHex
              ? "text"
              : "compressed data",
          file_->size_bytes(), std::max<std::int64_t>(stream_->position() - skip, 0)));
    }
    if (begin + static_cast<std::int64_t>(size) == bytes_per_file_) {
      return stream_->VerifyEnd();
    }
    return absl::OkStatus();
  }

  // Returns the decoded bytes before the samples of the open file. If the samples are its last
  // bytes, it is decoded once to count them. REQUIRES: stream_ is set.
  absl::StatusOr<std::int64_t> DecodedSkip() {
    if (!location_.at_file_end) {
      return location_.decoded_skip;
    }
    if (const auto known = end_skips_.find(open_index_); known != end_skips_.end()) {
      return known->second;
    }
    stream_->Rewind();
    ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t size,
                              stream_->Skip(bytes_per_file_ + kMaxSkipBytes + 1));
    ISOSCOPE_RETURN_IF_ERROR(stream_->VerifyEnd());
    if (size < bytes_per_file_ || size > bytes_per_file_ + kMaxSkipBytes) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: %s%d bytes of compressed data; expected %d bytes of samples at their end, and at "
          "most %d before",
          file_->path(), size < bytes_per_file_ ? "" : "more than ",
          std::min(size, bytes_per_file_ + kMaxSkipBytes), bytes_per_file_, kMaxSkipBytes));
    }
    return end_skips_.emplace(open_index_, size - bytes_per_file_).first->second;
  }

  SampleLocation location_;
  std::int64_t bytes_per_file_;
  std::map<std::size_t, std::int64_t> end_skips_;  // of DecodedSkip, by file
  std::vector<Fetched> fetched_;                   // ascending
  std::size_t open_index_ = 0;
  std::unique_ptr<io::RandomAccessFile> file_;
  std::unique_ptr<DecodedStream> stream_;
};

absl::Status StoredBytes::CheckFiles(const volume::GridGeometry& geometry) {
  std::size_t longer_count = 0;
  std::size_t first_longer = 0;
  for (std::size_t i = location_.files.size(); i-- > 0;) {  // the first one stays open
    ISOSCOPE_RETURN_IF_ERROR(Open(i));
    if (location_.is_encoded()) {
      continue;  // its size does not tell the length
    }
    const std::int64_t file_size = file_->size_bytes();
    if (offset() > file_size || file_size - offset() < bytes_per_file_) {
      const math::Index3& dims = geometry.sample_dims;
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: %d x %d x %d samples of %s%s%s after %d header bytes need %d bytes, the file has "
          "%d: "
          "it is cut, or its sizes are others",
          file_->path(), dims.x, dims.y, dims.z, volume::NameOf(location_.stored_type),
          location_.volume_count * location_.components == 1
              ? ""
              : absl::StrFormat(", %d volumes of %d components,", location_.volume_count,
                                location_.components),
          location_.files.size() == 1 ? ""
                                      : absl::StrFormat(" in %d files", location_.files.size()),
          offset(), offset() + bytes_per_file_, file_size));
    }
    if (file_size - offset() > bytes_per_file_ && !location_.has_more_behind) {
      ++longer_count;
      first_longer = i;
    }
  }
  if (longer_count > 0) {
    ISOSCOPE_RETURN_IF_ERROR(Open(first_longer));
    base::LogWarning("trailing_bytes_ignored", {{"file", base::OwnText{file_->path()}},
                                                {"expected_bytes", offset() + bytes_per_file_},
                                                {"found_bytes", file_->size_bytes()},
                                                {"files", longer_count}});
  }
  return absl::OkStatus();
}

class FileSource final : public VolumeSource {
 public:
  FileSource(const volume::GridGeometry& geometry, StoredBytes stored, const std::string& name,
             const std::optional<volume::PatientFrame>& patient_frame)
      : VolumeSource({.name = name,
                      .geometry = geometry,
                      .type = IsRescaled(stored.location())
                                  ? RescaledType(stored.location().stored_type)
                                  : stored.location().stored_type,
                      .patient_frame = patient_frame,
                      .is_seekable = !stored.location().is_encoded(),
                      .memory_bytes = MemoryBytes(stored.location())}),
        stored_(std::move(stored)) {}

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    const math::Index3& dims = info().geometry.sample_dims;
    const std::int64_t row_count = dims.y * dims.z;
    ISOSCOPE_CHECK(begin_row >= 0 && begin_row < end_row && end_row <= row_count);
    return ReadSamples(begin_row * dims.x, static_cast<std::size_t>((end_row - begin_row) * dims.x),
                       &stored_, &tuples_, out);
  }

  [[nodiscard]] std::optional<BoxGrid> box_grid() const override {
    if (location().is_encoded()) {
      return std::nullopt;
    }
    return BoxGrid{.box_dims = stored_.is_far()
                                   ? FarRowBoxDims(info().geometry.sample_dims, tuple_bytes())
                                   : kRowBoxDims};
  }
  [[nodiscard]] absl::Status ReadBox(const math::IndexBox& box, char* out,
                                     const base::Cancellation& cancellation) const override {
    const math::Index3& whole = info().geometry.sample_dims;
    const std::size_t sample_bytes = volume::SizeOf(info().type);
    StoredBytes stored = stored_.Again();
    std::vector<char> tuples;
    const auto read = [&](std::int64_t first, std::size_t count, char* samples) {
      return ReadSamples(first, count, &stored, &tuples, samples);
    };
    if (!stored_.is_far()) {
      return ReadBoxRows(whole, box, sample_bytes, out, cancellation, read);
    }
    math::IndexBox planes = box;
    planes.end.z = box.begin.z + 1;
    std::int64_t plane_bytes = 0;
    for (const RowRun& run : RunsOfBox(whole, planes)) {
      plane_bytes += static_cast<std::int64_t>(run.count) * tuple_bytes();
    }
    ISOSCOPE_CHECK_GT(plane_bytes, 0);
    const std::int64_t at_once = std::max<std::int64_t>(kFetchedBytes / plane_bytes, 1);
    for (; planes.begin.z < box.end.z; planes.begin.z = planes.end.z) {
      planes.end.z = std::min(planes.begin.z + at_once, box.end.z);
      ISOSCOPE_RETURN_IF_ERROR(stored.Fetch(StretchesOf(planes), cancellation));
      ISOSCOPE_RETURN_IF_ERROR(ReadBoxRows(whole, planes, sample_bytes, out, cancellation, read));
      out += math::Volume(planes.dims()) * static_cast<std::int64_t>(sample_bytes);
    }
    return absl::OkStatus();
  }

 private:
  // The stretches that ReadBox reads of a box.
  [[nodiscard]] std::vector<StoredBytes::Stretch> StretchesOf(const math::IndexBox& box) const {
    const math::Index3& whole = info().geometry.sample_dims;
    const std::int64_t begin = location().volume * math::Volume(whole);
    std::vector<StoredBytes::Stretch> stretches;
    for (const RowRun& run : RunsOfBox(whole, box)) {
      stretches.push_back({.begin = (begin + run.first) * tuple_bytes(),
                           .size = run.count * static_cast<std::size_t>(tuple_bytes())});
    }
    return stretches;
  }

  // Reads samples of the volume, from number `first` on. tuples: a buffer
  absl::Status ReadSamples(std::int64_t first, std::size_t count, StoredBytes* from,
                           std::vector<char>* tuples, char* out) const {
    const std::size_t stored_size = volume::SizeOf(location().stored_type);
    const std::int64_t begin =
        location().volume * math::Volume(info().geometry.sample_dims) + first;  // of tuples
    char* stored = out + count * (volume::SizeOf(info().type) - stored_size);
    ISOSCOPE_RETURN_IF_ERROR(location().components == 1
                                 ? from->Read(begin * tuple_bytes(), count * stored_size, stored)
                                 : ReadComponent(begin, count, from, tuples, stored));
    if (location().is_big_endian) {
      SwapBytes(stored_size, count, stored);
    }
    if (IsRescaled(location())) {
      Rescale(location().stored_type, count, location().slope, location().intercept, stored, out);
    }
    return absl::OkStatus();
  }
  [[nodiscard]] const SampleLocation& location() const { return stored_.location(); }
  static std::int64_t TupleBytes(const SampleLocation& location) {
    return location.components * static_cast<std::int64_t>(volume::SizeOf(location.stored_type));
  }
  static std::int64_t MemoryBytes(const SampleLocation& location) {
    return DecodedStreamBytes(location.encoding) +
           (location.components > 1 ? std::max(kStoredTupleBytes, TupleBytes(location)) : 0);
  }
  [[nodiscard]] std::int64_t tuple_bytes() const { return TupleBytes(location()); }

  // The component of `count` tuples from `begin` on, as it is stored.
  absl::Status ReadComponent(std::int64_t begin, std::size_t count, StoredBytes* stored,
                             std::vector<char>* buffer, char* out) const {
    const std::size_t size = volume::SizeOf(location().stored_type);
    const auto step = static_cast<std::size_t>(tuple_bytes());
    const auto at_once =
        static_cast<std::size_t>(std::max<std::int64_t>(kStoredTupleBytes / tuple_bytes(), 1));
    while (count > 0) {
      const std::size_t tuples = std::min(count, at_once);
      buffer->resize(tuples * step);
      ISOSCOPE_RETURN_IF_ERROR(stored->Read(begin * tuple_bytes(), buffer->size(), buffer->data()));
      const char* from = buffer->data() + static_cast<std::size_t>(location().component) * size;
      for (std::size_t i = 0; i < tuples; ++i) {
        out = std::copy_n(from + i * step, size, out);
      }
      begin += static_cast<std::int64_t>(tuples);
      count -= tuples;
    }
    return absl::OkStatus();
  }

  StoredBytes stored_;
  std::vector<char> tuples_;  // of several components
};

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSource>> MakeFileSource(
    const volume::GridGeometry& geometry, const SampleLocation& location, const std::string& name,
    const std::optional<volume::PatientFrame>& patient_frame) {
  const absl::Status valid = volume::Validate(geometry);
  if (!valid.ok()) {
    return absl::Status(valid.code(), absl::StrCat(name, ": ", valid.message()));
  }
  const std::int64_t sample_count = math::Volume(geometry.sample_dims);
  const auto stored_size = static_cast<std::int64_t>(volume::SizeOf(location.stored_type));
  constexpr std::int64_t kMaxSamples = std::numeric_limits<std::int64_t>::max() / 16;
  if (sample_count > kMaxSamples ||
      location.volume_count > kMaxSamples / sample_count / location.components) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %d samples: more than any file holds", name, sample_count));
  }
  const std::int64_t stored_count = sample_count * location.volume_count * location.components;
  if (location.files.empty() ||
      stored_count % static_cast<std::int64_t>(location.files.size()) != 0) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %d samples in %d files; expected as many in each", name, stored_count,
                        location.files.size()));
  }
  if (location.is_encoded() && io::IsMounted(location.files.front())) {
    return absl::InvalidArgumentError(
        absl::StrCat(name,
                     ": samples that are compressed as a whole, or text, at an address need the "
                     "whole file; bring it with: isoscope copy ",
                     location.files.front()));
  }
  StoredBytes stored(location, stored_count * stored_size);
  ISOSCOPE_RETURN_IF_ERROR(stored.CheckFiles(geometry));
  return std::make_unique<FileSource>(geometry, std::move(stored), name, patient_frame);
}

}  // namespace isoscope::source
