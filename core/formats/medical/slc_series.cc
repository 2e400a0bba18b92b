// An SLC file begins with text:
//
//   11111
//   64 64 93 8          voxels along x, y and z; bits a voxel
//   1.0 1.0 2.0         spacing
//   1 0 0 1             unit, origin and modification of the data, compression (0 or 1)
//   32 32 X             an icon, whose width * height * 3 bytes follow the X
//
// Then the slices follow: plain, or each as "SIZE X" and so many bytes of runs. A run begins with a
// byte whose low 7 bits are its length, 0 at the end of the slice. With the high bit set as many
// voxels follow, else one voxel that is repeated. Source: vtkSLCReader of VTK.

#include "core/formats/medical/slc_series.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/source/adapt/slice_source.h"
#include "core/source/bytes/located_series.h"
#include "core/source/bytes/text_scanner.h"

namespace isoscope::source {
namespace {

constexpr absl::string_view kSlcMark = "11111";
constexpr std::int64_t kMaxSlcAxis = 65'536;
constexpr auto kMaxSlcSpacing = static_cast<double>(std::numeric_limits<float>::max());
// Two bytes give 127 voxels at most.
constexpr std::int64_t kMaxSlcRatio = 64;

struct SlcSlice {
  std::int64_t offset = 0;
  std::int64_t size = 0;
};

struct SlcLayout {
  volume::GridGeometry geometry;
  bool is_compressed = false;
  std::int64_t offset = 0;         // of the slices
  std::vector<SlcSlice> slices{};  // if compressed
};

absl::StatusOr<double> NextSlcNumber(TextScanner* scanner, double least, double most) {
  ISOSCOPE_ASSIGN_OR_RETURN(const absl::string_view word, scanner->NextWord());
  double number = 0;
  if (!absl::SimpleAtod(word, &number) || !(number >= least && number <= most)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("\"%s\" before offset %d; expected a number from %g to %g",
                        word.substr(0, 40), scanner->position(), least, most));
  }
  return number;
}

// Moves behind the X that follows numbers, without a break before the bytes behind it.
absl::Status PassSlcMark(const io::RandomAccessFile& file, TextScanner* scanner) {
  const std::int64_t begin = scanner->position();
  std::string next(
      static_cast<std::size_t>(std::clamp<std::int64_t>(file.size_bytes() - begin, 0, 8)), '\0');
  ISOSCOPE_RETURN_IF_ERROR(file.ReadAt(begin, next.size(), next.data()));
  const std::size_t mark = next.find_first_not_of(" \t\r\n");
  if (mark == std::string::npos || next[mark] != 'X') {
    return absl::InvalidArgumentError(
        absl::StrFormat("no X after the numbers before offset %d: it is damaged or cut", begin));
  }
  scanner->MoveTo(begin + static_cast<std::int64_t>(mark) + 1);
  return absl::OkStatus();
}

absl::Status FindSlcSlices(const io::RandomAccessFile& file, TextScanner* scanner,
                           SlcLayout* layout) {
  const math::Index3& dims = layout->geometry.sample_dims;
  for (std::int64_t z = 0; z < dims.z; ++z) {
    ISOSCOPE_ASSIGN_OR_RETURN(const double size, NextSlcNumber(scanner, 1, 0x1p40));
    ISOSCOPE_RETURN_IF_ERROR(PassSlcMark(file, scanner));
    const SlcSlice slice{scanner->position(), static_cast<std::int64_t>(size)};
    if (slice.size > file.size_bytes() - slice.offset ||
        dims.x * dims.y > slice.size * kMaxSlcRatio) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "slice %d has %d bytes at offset %d; %d x %d voxels need more, or the file of %d bytes "
          "is cut",
          z, slice.size, slice.offset, dims.x, dims.y, file.size_bytes()));
    }
    layout->slices.push_back(slice);
    scanner->MoveTo(slice.offset + slice.size);
  }
  return absl::OkStatus();
}

absl::StatusOr<SlcLayout> ReadSlcLayout(const io::RandomAccessFile& file) {
  TextScanner scanner(&file);
  ISOSCOPE_ASSIGN_OR_RETURN(const absl::string_view mark, scanner.NextWord());
  if (mark != kSlcMark) {
    return absl::InvalidArgumentError("no SLC file: it does not begin with 11111");
  }
  SlcLayout layout;
  for (int axis = 0; axis < 3; ++axis) {
    ISOSCOPE_ASSIGN_OR_RETURN(const double size, NextSlcNumber(&scanner, 1, kMaxSlcAxis));
    layout.geometry.sample_dims[axis] = static_cast<std::int64_t>(size);
  }
  ISOSCOPE_RETURN_IF_ERROR(NextSlcNumber(&scanner, 8, 8).status());  // bits a voxel
  for (int axis = 0; axis < 3; ++axis) {
    ISOSCOPE_ASSIGN_OR_RETURN(layout.geometry.spacing[axis],
                              NextSlcNumber(&scanner, 0, kMaxSlcSpacing));
  }
  for (int skipped = 0; skipped < 3; ++skipped) {
    ISOSCOPE_RETURN_IF_ERROR(NextSlcNumber(&scanner, -1e9, 1e9).status());
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const double compression, NextSlcNumber(&scanner, 0, 1));
  layout.is_compressed = compression != 0;
  ISOSCOPE_ASSIGN_OR_RETURN(const double width, NextSlcNumber(&scanner, 0, kMaxSlcAxis));
  ISOSCOPE_ASSIGN_OR_RETURN(const double height, NextSlcNumber(&scanner, 0, kMaxSlcAxis));
  ISOSCOPE_RETURN_IF_ERROR(PassSlcMark(file, &scanner));
  layout.offset = scanner.position() + static_cast<std::int64_t>(3 * width * height);
  scanner.MoveTo(layout.offset);
  if (layout.is_compressed) {
    ISOSCOPE_RETURN_IF_ERROR(FindSlcSlices(file, &scanner, &layout));
  }
  return layout;
}

class SlcSlices final : public SliceReader {
 public:
  SlcSlices(std::unique_ptr<io::RandomAccessFile> file, SlcLayout layout)
      : file_(std::move(file)), layout_(std::move(layout)) {}

  absl::Status ReadSlice(std::int64_t z, char* out) override {
    const SlcSlice& slice = layout_.slices[static_cast<std::size_t>(z)];
    const math::Index3& dims = layout_.geometry.sample_dims;
    runs_.resize(static_cast<std::size_t>(slice.size));
    ISOSCOPE_RETURN_IF_ERROR(file_->ReadAt(slice.offset, runs_.size(), runs_.data()));
    auto left = static_cast<std::size_t>(dims.x * dims.y);
    std::size_t next = 0;
    while (next < runs_.size()) {
      const auto head = static_cast<unsigned char>(runs_[next++]);
      const std::size_t length = head & 0x7fU;
      const bool is_repeated = (head & 0x80U) == 0;
      if (length == 0) {
        break;
      }
      if (length > left || runs_.size() - next < (is_repeated ? 1 : length)) {
        return Damaged(z);
      }
      if (is_repeated) {
        out = std::fill_n(out, length, runs_[next++]);
      } else {
        out = std::copy_n(runs_.data() + next, length, out);
        next += length;
      }
      left -= length;
    }
    return left == 0 ? absl::OkStatus() : Damaged(z);
  }

 private:
  [[nodiscard]] absl::Status Damaged(std::int64_t z) const {
    return absl::DataLossError(absl::StrFormat(
        "%s: the runs of slice %d do not give its voxels: the file is damaged", file_->path(), z));
  }

  const std::unique_ptr<io::RandomAccessFile> file_;
  const SlcLayout layout_;
  std::string runs_;
};

// The series of a compressed file.
class SlcSeries final : public VolumeSeries {
 public:
  SlcSeries(std::string path, const std::string& field, SlcLayout layout)
      : path_(std::move(path)), fields_{{.name = field}}, layout_(std::move(layout)) {}

  [[nodiscard]] const std::string& name() const override { return path_; }
  [[nodiscard]] const std::vector<SourceField>& fields() const override { return fields_; }
  [[nodiscard]] const std::vector<double>& times() const override { return times_; }
  [[nodiscard]] const std::string& time_unit() const override { return no_unit_; }
  [[nodiscard]] const std::string& length_unit() const override { return no_unit_; }

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int field, int component, int step) override {
    ISOSCOPE_CHECK(field == 0 && component == 0 && step == 0);
    ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<io::RandomAccessFile> file,
                              io::OpenRandomAccessFile(path_));
    return MakeSliceSource(layout_.geometry, volume::ScalarType::kUint8, path_,
                           std::make_unique<SlcSlices>(std::move(file), layout_));
  }

 private:
  const std::string path_;
  const std::vector<SourceField> fields_;
  const SlcLayout layout_;
  const std::vector<double> times_;
  const std::string no_unit_;
};

}  // namespace

bool IsSlc(absl::string_view head) {
  return absl::StartsWith(head, kSlcMark) && head.size() > kSlcMark.size() &&
         (head[kSlcMark.size()] == '\n' || head[kSlcMark.size()] == ' ' ||
          head[kSlcMark.size()] == '\r');
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenSlcSeries(const std::string& file,
                                                            const std::string& field) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::RandomAccessFile> opened,
                            io::OpenRandomAccessFile(file));
  auto layout = ReadSlcLayout(*opened);
  const absl::Status status = layout.ok() ? volume::Validate(layout->geometry) : layout.status();
  if (!status.ok()) {
    return absl::Status(status.code(), absl::StrCat(file, ": ", status.message()));
  }
  if (layout->is_compressed) {
    return std::make_unique<SlcSeries>(file, field, *std::move(layout));
  }
  LocatedFile located{.geometry = layout->geometry};
  located.fields.push_back({.field = {.name = field},
                            .location = SampleLocation{.files = {file}, .offset = layout->offset}});
  return MakeLocatedSeries(file, std::move(located));
}

}  // namespace isoscope::source
