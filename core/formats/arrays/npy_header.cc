// An array is a mark, a version, a dictionary of Python, and the samples without gaps:
//
//   93 4e 55 4d 50 59        "\x93NUMPY"
//   01 00                    version 1.0; 2.0 and 3.0 are the others
//   76 00                    bytes of the dictionary, uint16; from version 2 on uint32
//   {'descr': '<f4', 'fortran_order': False, 'shape': (93, 64, 64), }     spaces, a line feed
//
// Samples follow at once. Version 3 has UTF-8 in names of records, which are not read. Python 2
// wrote numbers of a shape as "93L". Source: numpy.lib.format, "Format Version 1.0" and on.

#include "core/formats/arrays/npy_header.h"

#include <algorithm>
#include <array>
#include <limits>
#include <set>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/coding.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/source/grid/axis_order.h"

namespace isoscope::source {
namespace {

constexpr absl::string_view kNpyMark("\x93NUMPY", 6);
constexpr std::size_t kMaxAxes = 32;  // of NumPy 1; NumPy 2 has 64

absl::Status NpyError(const std::string& name, absl::string_view what) {
  return absl::InvalidArgumentError(absl::StrCat(name, ": NumPy header: ", what));
}

struct KnownDescr {
  absl::string_view code;  // without its byte order
  volume::ScalarType type;
  std::optional<WideType> wide;
};

constexpr std::array<KnownDescr, 12> kDescrs{
    {{"b1", volume::ScalarType::kUint8, std::nullopt},
     {"u1", volume::ScalarType::kUint8, std::nullopt},
     {"i1", volume::ScalarType::kInt8, std::nullopt},
     {"u2", volume::ScalarType::kUint16, std::nullopt},
     {"i2", volume::ScalarType::kInt16, std::nullopt},
     {"u4", volume::ScalarType::kUint32, std::nullopt},
     {"i4", volume::ScalarType::kInt32, std::nullopt},
     {"f4", volume::ScalarType::kFloat32, std::nullopt},
     {"f8", volume::ScalarType::kFloat64, std::nullopt},
     {"u8", volume::ScalarType::kFloat64, WideType::kUint64},
     {"i8", volume::ScalarType::kFloat64, WideType::kInt64},
     {"f2", volume::ScalarType::kUint16, WideType::kFloat16}}};

absl::Status RefuseDescr(const std::string& descr, const std::string& name) {
  const char kind = descr.size() > 1 ? descr[1] : ' ';
  const char* what = "a type that no volume has";
  const char* advice = "save array.astype(numpy.float32)";
  if (kind == 'O') {
    what = "Python objects, which are a pickle: reading one runs code of its author";
    advice = "save numpy.stack(list(array)).astype(numpy.float32)";
  } else if (kind == 'c') {
    what = "complex numbers";
    advice = "save numpy.abs(array), array.real or array.imag";
  } else if (kind == 'V') {
    what = "records, or bytes without a meaning";
    advice = "save one of them: array[NAME]";
  } else if (kind == 'S' || kind == 'U') {
    what = "texts";
    advice = "give an array of numbers";
  } else if (kind == 'M' || kind == 'm') {
    what = "dates or times";
    advice = "save array.astype(numpy.int64)";
  }
  return NpyError(name,
                  absl::StrFormat("descr %s: %s; %s", base::Quoted(descr, '\''), what, advice));
}

absl::Status TakeDescr(const std::string& descr, const std::string& name, NpyHeader* header) {
  const char order = descr.empty() ? ' ' : descr.front();
  const auto* const known =
      std::find_if(kDescrs.begin(), kDescrs.end(), [&](const KnownDescr& each) {
        return absl::string_view(descr).substr(std::min<std::size_t>(1, descr.size())) == each.code;
      });
  if (known == kDescrs.end() || !absl::StrContains("<>|=", absl::string_view(&order, 1))) {
    return RefuseDescr(descr, name);
  }
  header->type = known->type;
  header->wide = known->wide;
  header->is_big_endian = order == '>';
  if (header->sample_bytes() > 1 && order != '<' && order != '>') {
    return NpyError(name, absl::StrFormat("descr '%s' does not say the byte order; expected '<' or "
                                          "'>' in front: save the array again with numpy.save",
                                          descr));
  }
  return absl::OkStatus();
}

// Parses the dictionary, which has the syntax of Python's literals.
class DictParser {
 public:
  DictParser(absl::string_view text, const std::string& name) : rest_(text), name_(name) {}

  absl::Status Parse(NpyHeader* header) {
    ISOSCOPE_RETURN_IF_ERROR(Expect('{'));
    std::set<std::string> keys;
    while (!Take('}')) {
      ISOSCOPE_ASSIGN_OR_RETURN(const std::string key, String());
      ISOSCOPE_RETURN_IF_ERROR(Expect(':'));
      if (!keys.insert(key).second) {
        return Bad(absl::StrCat("a key that stands there once, not '", key, "' again"));
      }
      ISOSCOPE_RETURN_IF_ERROR(Value(key, header));
      if (!Take(',')) {
        ISOSCOPE_RETURN_IF_ERROR(Expect('}'));
        break;
      }
    }
    if (keys.size() != 3) {
      return NpyError(name_, absl::StrFormat("keys %s; expected descr, fortran_order and shape: "
                                             "damaged",
                                             absl::StrJoin(keys, ", ")));
    }
    SkipSpace();
    return rest_.empty() ? absl::OkStatus() : Bad("nothing behind the dictionary");
  }

 private:
  absl::Status Value(const std::string& key, NpyHeader* header) {
    if (key == "descr") {
      SkipSpace();
      if (absl::StartsWith(rest_, "[") || absl::StartsWith(rest_, "(") ||
          absl::StartsWith(rest_, "{")) {
        return NpyError(name_,
                        "records of several numbers (a structured array); save one of them: "
                        "array[NAME]");
      }
      ISOSCOPE_ASSIGN_OR_RETURN(const std::string descr, String());
      return TakeDescr(descr, name_, header);
    }
    if (key == "fortran_order") {
      SkipSpace();
      header->is_fortran = absl::StartsWith(rest_, "True");
      if (!header->is_fortran && !absl::StartsWith(rest_, "False")) {
        return Bad("True or False");
      }
      rest_.remove_prefix(header->is_fortran ? 4 : 5);
      return absl::OkStatus();
    }
    return key == "shape" ? Shape(header) : Bad("'descr', 'fortran_order' or 'shape' as a key");
  }

  absl::Status Shape(NpyHeader* header) {
    ISOSCOPE_RETURN_IF_ERROR(Expect('('));
    bool needs_comma = false;  // "(5)" is no tuple
    while (!Take(')')) {
      if (needs_comma) {
        return Bad("a comma between numbers of the shape");
      }
      SkipSpace();
      std::size_t digits = 0;
      while (digits < rest_.size() &&
             absl::ascii_isdigit(static_cast<unsigned char>(rest_[digits]))) {
        ++digits;
      }
      std::int64_t number = 0;
      if (digits == 0 || !absl::SimpleAtoi(rest_.substr(0, digits), &number)) {
        return Bad("a number of the shape, of 63 bits");
      }
      rest_.remove_prefix(digits);
      if (absl::StartsWith(rest_, "L")) {
        rest_.remove_prefix(1);
      }
      if (header->shape.size() == kMaxAxes) {
        return NpyError(name_, absl::StrCat("a shape of more than ", kMaxAxes, " axes"));
      }
      header->shape.push_back(number);
      needs_comma = !Take(',');
    }
    return needs_comma && header->shape.size() == 1 ? Bad("a comma in a shape of one number")
                                                    : absl::OkStatus();
  }

  void SkipSpace() {
    while (!rest_.empty() && (rest_[0] == ' ' || rest_[0] == '\n' || rest_[0] == '\t')) {
      rest_.remove_prefix(1);
    }
  }
  bool Take(char c) {
    SkipSpace();
    const bool is_there = !rest_.empty() && rest_[0] == c;
    rest_.remove_prefix(is_there ? 1 : 0);
    return is_there;
  }
  absl::Status Expect(char c) {
    return Take(c) ? absl::OkStatus() : Bad(absl::StrCat("'", std::string(1, c), "'"));
  }
  absl::StatusOr<std::string> String() {
    SkipSpace();
    const char mark = rest_.empty() ? ' ' : rest_[0];
    const std::size_t end = mark == '\'' || mark == '"' ? rest_.find(mark, 1) : rest_.npos;
    if (end == rest_.npos || absl::StrContains(rest_.substr(0, end), "\\")) {
      return Bad("a text between quotation marks");
    }
    const std::string text(rest_.substr(1, end - 1));
    rest_.remove_prefix(end + 1);
    return text;
  }
  [[nodiscard]] absl::Status Bad(absl::string_view expected) const {
    return NpyError(name_, absl::StrCat("expected ", expected, " at ",
                                        base::Quoted(rest_.substr(0, 40)), ": damaged"));
  }

  absl::string_view rest_;
  const std::string& name_;
};

}  // namespace

std::int64_t NpyHeader::SampleCount() const {
  constexpr std::int64_t kMost = std::numeric_limits<std::int64_t>::max() / 16;
  if (std::find(shape.begin(), shape.end(), 0) != shape.end()) {
    return 0;
  }
  std::int64_t count = 1;
  for (const std::int64_t length : shape) {
    if (length > kMost / count) {
      return -1;
    }
    count *= length;
  }
  return count;
}

bool IsNpyHeader(absl::string_view head) { return absl::StartsWith(head, kNpyMark); }

absl::StatusOr<NpyHeader> ParseNpyHeader(absl::string_view head, const std::string& name) {
  if (!IsNpyHeader(head)) {
    return absl::InvalidArgumentError(absl::StrCat(
        name, ": does not begin with \"\\x93NUMPY\": not a NumPy array, though its name says so"));
  }
  if (head.size() < 12) {
    return NpyError(name, absl::StrFormat("%d bytes of file: it is cut", head.size()));
  }
  const int major = static_cast<unsigned char>(head[6]);
  const int minor = static_cast<unsigned char>(head[7]);
  if (major < 1 || major > 3 || minor != 0) {
    return NpyError(name, absl::StrFormat("version %d.%d; expected 1.0, 2.0 or 3.0: save the array "
                                          "again with numpy.save",
                                          major, minor));
  }
  const std::size_t start = major == 1 ? 10 : 12;
  const std::uint32_t size = major == 1 ? base::LoadLittleEndian<std::uint16_t>(head.data() + 8)
                                        : base::LoadLittleEndian<std::uint32_t>(head.data() + 8);
  if (size > kNpyHeadBytes - 12) {
    return NpyError(name, absl::StrFormat("%d bytes of header; expected at most %d: damaged", size,
                                          kNpyHeadBytes - 12));
  }
  if (head.size() - start < size) {
    return NpyError(name, absl::StrFormat("%d bytes of header in %d bytes of file: it is cut", size,
                                          head.size()));
  }
  NpyHeader header{.samples_start = static_cast<std::int64_t>(start + size)};
  ISOSCOPE_RETURN_IF_ERROR(DictParser(head.substr(start, size), name).Parse(&header));
  return header;
}

absl::StatusOr<volume::GridGeometry> NpyGrid(const NpyHeader& header, const std::string& name) {
  auto begin = header.shape.begin();
  auto end = header.shape.end();
  while (end - begin > 3 && *begin == 1) {
    ++begin;
  }
  while (end - begin > 3 && *(end - 1) == 1) {
    --end;
  }
  if (end - begin != 3) {
    return NpyError(
        name,
        absl::StrFormat("shape (%s); expected three axes, array[z, y, x]%s",
                        absl::StrJoin(header.shape, ", "),
                        end - begin > 3 ? ": save one volume of it, numpy.save(FILE, array[0]),"
                                          " or array[..., 0] for the first channel"
                                        : ""));
  }
  volume::GridGeometry geometry;
  geometry.sample_dims = {begin[2], begin[1], begin[0]};
  if (header.is_fortran) {
    geometry.sample_dims = {begin[0], begin[1], begin[2]};
    geometry.direction.columns = {{{0, 0, 1}, {0, 1, 0}, {1, 0, 0}}};
  }
  const absl::Status valid = volume::Validate(geometry);
  return valid.ok() ? absl::StatusOr<volume::GridGeometry>(geometry)
                    : absl::Status(valid.code(), absl::StrCat(name, ": ", valid.message()));
}

absl::StatusOr<NpyVolumes> NpyVolumesOf(const NpyHeader& header, const std::string& axes,
                                        const std::string& name) {
  const auto order = ParseAxisOrder(axes);
  const std::string shape = absl::StrCat("shape (", absl::StrJoin(header.shape, ", "), ")");
  if (!order.ok() || axes.size() != header.shape.size()) {
    const std::string choices = AxisChoices(header.shape.size());
    return NpyError(name, absl::StrCat(shape, " and --axes ", axes, ": ",
                                       order.ok() ? "expected a letter for each axis"
                                                  : order.status().message(),
                                       choices.empty() ? "" : absl::StrCat(", such as ", choices)));
  }
  // 1. The axis beside those of space; axes of one element do not count.
  NpyVolumes volumes;
  std::size_t place = 0;
  for (std::size_t axis = 0; axis < axes.size(); ++axis) {
    if (axis == order->z || axis == order->y || axis == order->x || header.shape[axis] == 1) {
      continue;
    }
    const bool is_time = axis == order->t;
    if ((!is_time && axis != order->c) || volumes.count != 1) {
      return NpyError(name, absl::StrCat(shape, " and --axes ", axes,
                                         ": expected one of T and C, and - for axes of 1 element: "
                                         "save one volume of it, numpy.save(FILE, array[0])"));
    }
    volumes.count = header.shape[axis];
    volumes.are_steps = is_time;
    place = axis;
  }
  if (volumes.count != 1) {
    if (place > order->z && place < order->x) {
      return NpyError(name, absl::StrCat(shape, " and --axes ", axes,
                                         ": expected T or C in front of Z, Y and X, or behind: "
                                         "numpy.moveaxis(array, ",
                                         place, ", 0) has it there"));
    }
    volumes.are_fastest = (place > order->x) != header.is_fortran;
  }
  // 2. The grid.
  NpyHeader one = header;
  one.shape = {header.shape[order->z], header.shape[order->y], header.shape[order->x]};
  ISOSCOPE_ASSIGN_OR_RETURN(volumes.geometry, NpyGrid(one, name));
  return volumes;
}

}  // namespace isoscope::source
