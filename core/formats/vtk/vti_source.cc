// An array is opened by its format:
//
//   ascii              numbers as text (text_source.h)
//   binary, appended   bytes at any offset (vti_data.cc has the layout)
//
// Int64 and UInt64 get a source around, which makes float64 of them (wide_source.h). Components lie
// interleaved, x0 y0 z0 x1 y1 z1: ReadComponent reads 64 KiB of tuples at once, and keeps one
// component. The bytes of a big-endian file are swapped last.
//
// ReadVtiNumbers reads a whole short array: coordinates of a .vtr, or TimeValue. Source: VTK's file
// format description, "XML File Formats", https://docs.vtk.org.

#include "core/formats/vtk/vti_source.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <iterator>
#include <limits>
#include <map>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/formats/vtk/vti_choice.h"
#include "core/formats/vtk/vti_data.h"
#include "core/formats/vtk/vti_grid.h"
#include "core/formats/vtk/vti_header.h"
#include "core/io/file.h"
#include "core/io/mounted_file.h"
#include "core/source/adapt/wide_source.h"
#include "core/source/bytes/box_rows.h"
#include "core/source/bytes/byte_order.h"
#include "core/source/bytes/text_scanner.h"
#include "core/source/bytes/text_source.h"

namespace isoscope::source {
namespace {

// The bytes of interleaved components that are read at once, to pick one component. A single larger
// tuple exceeds it.
constexpr std::int64_t kTupleBytes = 64 * base::kKiB;

// At an address: what is fetched at once for a box; a plane of it may have more.
constexpr std::int64_t kFarBytes = base::kMiB;

// Stretches of the data, as they are fetched together.
class FetchedData final : public VtiData {
 public:
  void Add(std::int64_t offset, std::size_t size) { stretches_[offset] = std::string(size, '\0'); }
  // Where all of them are in a file that has the data from `start` on.
  std::vector<io::FilePiece> PiecesFrom(std::int64_t start) {
    std::vector<io::FilePiece> pieces;
    for (auto& [offset, bytes] : stretches_) {
      pieces.push_back(
          {.range = {.offset = start + offset, .size = bytes.size()}, .out = bytes.data()});
    }
    return pieces;
  }

  // REQUIRES: within one stretch.
  absl::Status ReadAt(std::int64_t offset, std::size_t size, char* out) override {
    const auto& [begin, bytes] = *std::prev(stretches_.upper_bound(offset));
    ISOSCOPE_CHECK(offset - begin + static_cast<std::int64_t>(size) <=
                   static_cast<std::int64_t>(bytes.size()));
    std::copy_n(bytes.data() + (offset - begin), size, out);
    return absl::OkStatus();
  }
  [[nodiscard]] std::int64_t memory_bytes() const override { return 0; }
  [[nodiscard]] std::unique_ptr<VtiData> Again() const override {
    return std::make_unique<FetchedData>(*this);
  }
  [[nodiscard]] std::optional<std::int64_t> block_bytes() const override { return 0; }

 private:
  std::map<std::int64_t, std::string> stretches_;  // by offset
};

class VtiSource final : public VolumeSource {
 public:
  VtiSource(SourceInfo info, const VtiChoice& choice, bool is_big_endian,
            std::unique_ptr<io::RandomAccessFile> file, std::unique_ptr<VtiData> data)
      : VolumeSource(std::move(info)),
        components_(choice.array.components),
        component_(choice.component),
        is_big_endian_(is_big_endian),
        file_(std::move(file)),
        data_(std::move(data)) {}

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    const math::Index3& dims = info().geometry.sample_dims;
    ISOSCOPE_CHECK(begin_row >= 0 && begin_row < end_row && end_row <= dims.y * dims.z);
    return ReadSamples(begin_row * dims.x, (end_row - begin_row) * dims.x, data_.get(), &tuples_,
                       out);
  }

  // Of blocks that are compressed, boxes are whole rows, and have the bytes of a block at least.
  [[nodiscard]] std::optional<BoxGrid> box_grid() const override {
    const std::optional<std::int64_t> block_bytes = data_->block_bytes();
    if (!block_bytes.has_value()) {
      return std::nullopt;
    }
    if (*block_bytes == 0) {
      return BoxGrid{.box_dims = io::IsMounted(file_->path())
                                     ? FarRowBoxDims(info().geometry.sample_dims, tuple_bytes())
                                     : kRowBoxDims};
    }
    const math::Index3& dims = info().geometry.sample_dims;
    const std::int64_t rows = *block_bytes / (dims.x * tuple_bytes()) + 1;  // of a block
    return BoxGrid{.box_dims = {dims.x, std::min(std::max(rows, kRowBoxDims.y), dims.y),
                                std::min(std::max(rows / dims.y + 1, kRowBoxDims.z), dims.z)}};
  }
  // A block, as it is and decoded, has the components' bytes of a box at most.
  [[nodiscard]] std::int64_t decoding_factor() const override {
    return data_->block_bytes().value_or(0) == 0 ? 1 : components_;
  }
  [[nodiscard]] absl::Status ReadBox(const math::IndexBox& box, char* out,
                                     const base::Cancellation& cancellation) const override {
    const std::optional<io::MountedFile> mounted =
        data_->plain_start().has_value() ? io::FindMounted(file_->path()) : std::nullopt;
    if (mounted.has_value() && mounted->read_pieces != nullptr) {
      return ReadFarBox(*mounted, box, out, cancellation);
    }
    const std::unique_ptr<VtiData> data = data_->Again();
    return ReadBoxFrom(data.get(), box, out, cancellation);
  }

 private:
  absl::Status ReadBoxFrom(VtiData* data, const math::IndexBox& box, char* out,
                           const base::Cancellation& cancellation) const {
    std::vector<char> tuples;
    return ReadBoxRows(info().geometry.sample_dims, box, volume::SizeOf(info().type), out,
                       cancellation, [&](std::int64_t first, std::size_t count, char* samples) {
                         return ReadSamples(first, static_cast<std::int64_t>(count), data, &tuples,
                                            samples);
                       });
  }

  // Planes after planes, the runs of kFarBytes of them at once.
  absl::Status ReadFarBox(const io::MountedFile& file, const math::IndexBox& box, char* out,
                          const base::Cancellation& cancellation) const {
    const math::Index3& whole = info().geometry.sample_dims;
    math::IndexBox planes = box;
    while (planes.begin.z < box.end.z) {
      planes.end.z = planes.begin.z;
      FetchedData fetched;
      std::int64_t bytes = 0;
      do {
        math::IndexBox plane = planes;
        plane.begin.z = planes.end.z++;
        plane.end.z = planes.end.z;
        for (const RowRun& run : RunsOfBox(whole, plane)) {
          fetched.Add(run.first * tuple_bytes(),
                      run.count * static_cast<std::size_t>(tuple_bytes()));
          bytes += static_cast<std::int64_t>(run.count) * tuple_bytes();
        }
      } while (planes.end.z < box.end.z && bytes < kFarBytes);
      ISOSCOPE_RETURN_IF_ERROR(
          file.read_pieces(fetched.PiecesFrom(*data_->plain_start()), cancellation));
      ISOSCOPE_RETURN_IF_ERROR(ReadBoxFrom(&fetched, planes, out, cancellation));
      out += math::Volume(planes.dims()) * sample_bytes();
      planes.begin.z = planes.end.z;
    }
    return absl::OkStatus();
  }

  // Reads samples from number `begin` on. tuples: a buffer
  absl::Status ReadSamples(std::int64_t begin, std::int64_t count, VtiData* data,
                           std::vector<char>* tuples, char* out) const {
    if (components_ == 1) {
      ISOSCOPE_RETURN_IF_ERROR(data->ReadAt(begin * sample_bytes(),
                                            static_cast<std::size_t>(count * sample_bytes()), out));
    } else {
      ISOSCOPE_RETURN_IF_ERROR(ReadComponent(begin, count, data, tuples, out));
    }
    if (is_big_endian_) {
      SwapBytes(volume::SizeOf(info().type), static_cast<std::size_t>(count), out);
    }
    return absl::OkStatus();
  }
  [[nodiscard]] std::int64_t sample_bytes() const {
    return static_cast<std::int64_t>(volume::SizeOf(info().type));
  }
  [[nodiscard]] std::int64_t tuple_bytes() const { return components_ * sample_bytes(); }

  // The component of `count` tuples from `begin` on.
  absl::Status ReadComponent(std::int64_t begin, std::int64_t count, VtiData* data,
                             std::vector<char>* buffer, char* out) const {
    const std::int64_t tuples_at_once = std::max<std::int64_t>(kTupleBytes / tuple_bytes(), 1);
    const auto size = volume::SizeOf(info().type);
    while (count > 0) {
      const std::int64_t tuples = std::min(count, tuples_at_once);
      buffer->resize(static_cast<std::size_t>(tuples * tuple_bytes()));
      ISOSCOPE_RETURN_IF_ERROR(data->ReadAt(begin * tuple_bytes(), buffer->size(), buffer->data()));
      const char* from = buffer->data() + component_ * sample_bytes();
      for (std::int64_t i = 0; i < tuples; ++i) {
        std::memcpy(out, from + i * tuple_bytes(), size);
        out += size;
      }
      begin += tuples;
      count -= tuples;
    }
    return absl::OkStatus();
  }

  const std::int64_t components_;  // of a tuple
  const std::int64_t component_;   // the one that is read
  const bool is_big_endian_;
  const std::unique_ptr<io::RandomAccessFile> file_;
  const std::unique_ptr<VtiData> data_;
  std::vector<char> tuples_;
};

// `file` is that of the header.
absl::StatusOr<std::unique_ptr<VolumeSource>> Open(std::unique_ptr<io::RandomAccessFile> file,
                                                   const VtiHeader& header, const VtiChoice& choice,
                                                   const volume::GridGeometry& geometry,
                                                   const std::string& name) {
  const std::optional<WideType> wide =
      choice.array.type == "Int64"    ? std::optional<WideType>(WideType::kInt64)
      : choice.array.type == "UInt64" ? std::optional<WideType>(WideType::kUint64)
                                      : std::nullopt;
  volume::ScalarType type = volume::ScalarType::kFloat64;
  if (wide.has_value()) {
    type = CarrierType(*wide);
  } else {
    ISOSCOPE_ASSIGN_OR_RETURN(type, VtiTypeOf(choice.array, file->path()));
  }
  const std::int64_t sample_count = math::Volume(geometry.sample_dims);
  if (sample_count > std::numeric_limits<std::int64_t>::max() / 16 / choice.array.components) {
    return absl::InvalidArgumentError(
        absl::StrCat(file->path(), ": more samples than any file holds"));
  }
  if (choice.array.format == "ascii") {
    return MakeTextSource(geometry,
                          {.file = file->path(),
                           .offset = choice.array.inline_start,
                           .type = type,
                           .wide = wide,
                           .components = choice.array.components,
                           .component = choice.component,
                           .ends_at_tag = true},
                          name);
  }
  const std::int64_t size =
      sample_count * choice.array.components * static_cast<std::int64_t>(volume::SizeOf(type));
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VtiData> data,
                            OpenVtiData(*file, header, choice.array, size));
  const std::int64_t tuple_bytes =
      choice.array.components * static_cast<std::int64_t>(volume::SizeOf(type));
  const std::int64_t memory_bytes =
      data->memory_bytes() + (choice.array.components > 1 ? std::max(kTupleBytes, tuple_bytes) : 0);
  std::unique_ptr<VolumeSource> source = std::make_unique<VtiSource>(
      SourceInfo{.name = name, .geometry = geometry, .type = type, .memory_bytes = memory_bytes},
      choice, header.is_big_endian, std::move(file), std::move(data));
  if (wide.has_value()) {
    return MakeWideSource(std::move(source), *wide);
  }
  return source;
}

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenVtiArray(const std::string& file,
                                                           const VtiHeader& header,
                                                           const VtiChoice& choice,
                                                           const volume::GridGeometry& geometry,
                                                           const std::string& name) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<io::RandomAccessFile> opened,
                            io::OpenRandomAccessFile(file));
  return Open(std::move(opened), header, choice, geometry, name);
}

absl::StatusOr<std::vector<double>> ReadVtiNumbers(const io::RandomAccessFile& file,
                                                   const VtiHeader& header, const VtiArray& array,
                                                   std::int64_t count) {
  ISOSCOPE_ASSIGN_OR_RETURN(const volume::ScalarType type, VtiTypeOf(array, file.path()));
  std::vector<double> numbers;
  if (array.format == "ascii") {
    TextScanner scanner(&file, array.inline_start);
    bool is_at_tag = false;
    while (static_cast<std::int64_t>(numbers.size()) < count) {
      ISOSCOPE_ASSIGN_OR_RETURN(absl::string_view word, scanner.NextWord());
      is_at_tag = absl::StrContains(word, '<');
      word = word.substr(0, word.find('<'));
      double number = 0;
      if (!absl::SimpleAtod(word, &number)) {
        return absl::InvalidArgumentError(
            absl::StrFormat("%s: array \"%s\": number %d is \"%s\"; expected %d numbers",
                            file.path(), array.name, numbers.size(), word.substr(0, 64), count));
      }
      numbers.push_back(number);
      if (is_at_tag && static_cast<std::int64_t>(numbers.size()) < count) {
        return absl::InvalidArgumentError(
            absl::StrFormat("%s: array \"%s\": %d numbers; expected %d", file.path(), array.name,
                            numbers.size(), count));
      }
    }
    return numbers;
  }
  const std::size_t size = volume::SizeOf(type);
  const std::int64_t bytes_size = count * static_cast<std::int64_t>(size);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<VtiData> data,
                            OpenVtiData(file, header, array, bytes_size));
  std::string bytes(static_cast<std::size_t>(bytes_size), '\0');
  ISOSCOPE_RETURN_IF_ERROR(data->ReadAt(0, bytes.size(), bytes.data()));
  if (header.is_big_endian) {
    SwapBytes(size, static_cast<std::size_t>(count), bytes.data());
  }
  volume::VisitScalarType(type, [&]<typename T>() {
    for (std::size_t i = 0; i < bytes.size(); i += sizeof(T)) {
      numbers.push_back(static_cast<double>(base::LoadLittleEndian<T>(&bytes[i])));
    }
  });
  return numbers;
}

absl::StatusOr<std::optional<double>> ReadVtiTime(const std::string& file,
                                                  const VtiHeader& header) {
  if (!header.time_value.has_value()) {
    return std::nullopt;
  }
  const VtiArray& array = *header.time_value;
  double time = std::numeric_limits<double>::quiet_NaN();
  if (array.format == "ascii") {
    if (!absl::SimpleAtod(absl::StripAsciiWhitespace(array.text), &time)) {
      time = std::numeric_limits<double>::quiet_NaN();
    }
  } else {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::RandomAccessFile> opened,
                              io::OpenRandomAccessFile(file));
    ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> times,
                              ReadVtiNumbers(*opened, header, array, 1));
    time = times[0];
  }
  if (!std::isfinite(time)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: its TimeValue is %s; expected a finite number", file,
        array.format == "ascii" ? absl::StrCat("\"", array.text, "\"") : absl::StrCat(time)));
  }
  return time;
}

}  // namespace isoscope::source
