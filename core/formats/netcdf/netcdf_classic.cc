// The header, big-endian; counts and offsets have 4 or 8 bytes by the version:
//
//   "CDF", version       1: 4-byte offsets; 2: 8-byte offsets; 5: 8-byte offsets and counts
//   number of records    all ones: written by a stream, and unknown
//   dimensions           tag 10, count; each a name and a length, 0 for the unlimited one
//   attributes           tag 12, count; each a name, a type, a count, values padded to 4 bytes
//   variables            tag 11, count; each a name, dimensions, attributes, type, size, offset
//
// The records of all variables with the unlimited dimension follow each other: record r of one
// begins at its offset + r * (the sum of the padded sizes of all). A single one is not padded.
// Source: "NetCDF File Formats",
// https://docs.unidata.ucar.edu/netcdf-c/current/file_format_specifications.html.

#include "core/formats/netcdf/netcdf_classic.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"

#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxClassicHeader = 16 * base::kMiB;

// Sizes are doubles: no product of a header's numbers overflows them.
struct ClassicVariable {
  double begin = 0;
  double size = 0;  // of a record, if it has them; without padding
  bool has_records = false;
};

double Padded(double size) {
  return size + static_cast<double>((4 - static_cast<std::int64_t>(size) % 4) % 4);
}

// Reads the header. After the first number that does not fit, is_good() is false.
class ClassicHeader {
 public:
  explicit ClassicHeader(absl::string_view bytes) : rest_(bytes.substr(4)), version_(bytes[3]) {
    const std::uint64_t records = Count();
    has_records_ = records != (version_ == 5 ? ~std::uint64_t{0} : 0xffffffffU);
    records_ = static_cast<double>(records);
    ReadDimensions();
    SkipAttributes();
    ReadVariables();
  }

  [[nodiscard]] bool is_good() const { return is_good_; }

  // The end of the last sample.
  [[nodiscard]] double End() const {
    double record_size = 0;
    std::int64_t record_variables = 0;
    for (const ClassicVariable& variable : variables_) {
      record_size += variable.has_records ? Padded(variable.size) : 0;
      record_variables += variable.has_records ? 1 : 0;
    }
    double end = 0;
    for (const ClassicVariable& variable : variables_) {
      if (!variable.has_records) {
        end = std::max(end, variable.begin + variable.size);
      } else if (has_records_ && records_ > 0) {
        const double step = record_variables == 1 ? variable.size : record_size;
        end = std::max(end, variable.begin + (records_ - 1) * step + variable.size);
      }
    }
    return end;
  }

 private:
  std::uint64_t Number(std::size_t bytes) {
    if (rest_.size() < bytes) {
      is_good_ = false;
      return 0;
    }
    std::uint64_t number = 0;
    for (std::size_t i = 0; i < bytes; ++i) {
      number = number << 8 | static_cast<unsigned char>(rest_[i]);
    }
    rest_.remove_prefix(bytes);
    return number;
  }
  std::uint64_t Count() { return Number(version_ == 5 ? 8 : 4); }
  void Skip(std::uint64_t bytes) {
    is_good_ = is_good_ && bytes <= rest_.size();
    rest_.remove_prefix(is_good_ ? static_cast<std::size_t>(bytes) : 0);
  }
  void SkipName() {
    const std::uint64_t size = Count();
    Skip(size > rest_.size() ? size : (size + 3) / 4 * 4);
  }
  // The count of a list; its elements have 4 bytes or more, so that it ends with the header.
  std::uint64_t List() {
    Number(4);  // the tag; 0 if there are none
    const std::uint64_t count = Count();
    is_good_ = is_good_ && count <= rest_.size();
    return is_good_ ? count : 0;
  }
  static std::uint64_t SizeOfType(std::uint64_t type) {
    constexpr std::array<std::uint64_t, 12> kSizes{0, 1, 1, 2, 4, 4, 8, 1, 2, 4, 8, 8};
    return type < kSizes.size() ? kSizes[static_cast<std::size_t>(type)] : 0;
  }

  void ReadDimensions() {
    for (std::uint64_t left = List(); is_good_ && left > 0; --left) {
      SkipName();
      dimensions_.push_back(static_cast<double>(Count()));
    }
  }

  void SkipAttributes() {
    for (std::uint64_t left = List(); is_good_ && left > 0; --left) {
      SkipName();
      const std::uint64_t size = SizeOfType(Number(4));
      const std::uint64_t count = Count();
      is_good_ = is_good_ && count <= rest_.size();
      Skip(is_good_ ? (size * count + 3) / 4 * 4 : 0);
    }
  }

  void ReadVariables() {
    for (std::uint64_t left = List(); is_good_ && left > 0; --left) {
      SkipName();
      ClassicVariable variable{.size = 1};
      std::uint64_t rank = Count();
      is_good_ = is_good_ && rank <= rest_.size();
      for (std::uint64_t i = 0; is_good_ && i < rank; ++i) {
        const std::uint64_t dimension = Count();
        is_good_ = is_good_ && dimension < dimensions_.size();
        const double length = is_good_ ? dimensions_[static_cast<std::size_t>(dimension)] : 1;
        variable.has_records = variable.has_records || (i == 0 && length == 0);
        variable.size *= i == 0 && length == 0 ? 1 : length;
      }
      SkipAttributes();
      variable.size *= static_cast<double>(SizeOfType(Number(4)));
      Count();  // the size as it is stored, of no use for large variables
      variable.begin = static_cast<double>(Number(version_ == 1 ? 4 : 8));
      // Beyond, the remainder of a padding would not be exact; no file is so long.
      is_good_ = is_good_ && variable.size < 0x1p60;
      variables_.push_back(variable);
    }
  }

  absl::string_view rest_;
  const char version_;
  bool is_good_ = true;
  bool has_records_ = true;
  double records_ = 0;
  std::vector<double> dimensions_;
  std::vector<ClassicVariable> variables_;
};

}  // namespace

absl::Status CheckClassicNetcdfLength(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::RandomAccessFile> file,
                            io::OpenRandomAccessFile(path));
  std::string bytes(static_cast<std::size_t>(std::min(file->size_bytes(), kMaxClassicHeader)),
                    '\0');
  ISOSCOPE_RETURN_IF_ERROR(file->ReadAt(0, std::min<std::size_t>(bytes.size(), 4), bytes.data()));
  if (!absl::StartsWith(bytes, "CDF") || bytes.size() < 4 ||
      (bytes[3] != 1 && bytes[3] != 2 && bytes[3] != 5)) {
    return absl::OkStatus();
  }
  ISOSCOPE_RETURN_IF_ERROR(file->ReadAt(0, bytes.size(), bytes.data()));
  const ClassicHeader header(bytes);
  if (!header.is_good()) {
    return absl::InvalidArgumentError(absl::StrCat(
        path, ": its netCDF header makes no sense, or ends after ", bytes.size(), " bytes"));
  }
  if (header.End() > static_cast<double>(file->size_bytes())) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: its netCDF header promises %.0f bytes, the file has %d: it is cut; "
                        "copy it again",
                        path, header.End(), file->size_bytes()));
  }
  return absl::OkStatus();
}

}  // namespace isoscope::source
