// Numbers can only be read one after the other. ReadRows takes these steps:
//
// 1. If the rows lie before the last number that was read, start over at the offset.
// 2. Skip the numbers up to the first sample.
// 3. Parse a number for each sample. Between two of them skip the other components.
//
// With three components, the samples of component 1 are the numbers 1, 4, 7, ...
//
// A number beyond the range of its type is an error. Integers of 64 bits may reach 2^53, which
// float64 holds. Floats may have Fortran's exponent ("1.5D-03"). MakeTextSource compares the size
// of the file with two bytes a number: a header that promises too much is an error at once.

#include "core/source/bytes/text_source.h"

#include <cmath>
#include <cstddef>
#include <limits>
#include <system_error>
#include <type_traits>
#include <utility>

#include "absl/strings/charconv.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "core/source/bytes/text_scanner.h"

namespace isoscope::source {
namespace {

// The exponent may be Fortran's ("1.5D-03"). A number too small for the type becomes 0 or its
// smallest one; one that is too large is none.
template <typename Float>
bool ParseTextFloat(absl::string_view word, Float* value) {
  std::string c_word;
  if (word.front() == '+' || word.find_first_of("dD") != absl::string_view::npos) {
    c_word = std::string(word.substr(word.front() == '+' ? 1 : 0));
    for (char& c : c_word) {
      c = c == 'd' || c == 'D' ? 'e' : c;
    }
    word = c_word;
  }
  const absl::from_chars_result result =
      absl::from_chars(word.data(), word.data() + word.size(), *value);
  const bool is_small = result.ec == std::errc::result_out_of_range && std::abs(*value) < 1;
  return (result.ec == std::errc() || is_small) && result.ptr == word.data() + word.size();
}

template <typename Integer>
bool ParseTextInteger(absl::string_view word, Integer* value) {
  std::int64_t wide = 0;
  if (!absl::SimpleAtoi(word, &wide) || wide < std::numeric_limits<Integer>::lowest() ||
      wide > static_cast<std::int64_t>(std::numeric_limits<Integer>::max())) {
    return false;
  }
  *value = static_cast<Integer>(wide);
  return true;
}

template <typename T>
bool ParseSample(absl::string_view word, char* out) {
  T value{};
  bool is_good = false;
  if constexpr (std::is_floating_point_v<T>) {
    is_good = ParseTextFloat(word, &value);
  } else {
    is_good = ParseTextInteger(word, &value);
  }
  base::StoreLittleEndian(value, out);
  return is_good;
}

// An integer of 64 bits that a double holds.
bool ParseWide(absl::string_view word, char* out) {
  constexpr std::int64_t kMaxExact = std::int64_t{1} << 53;
  std::int64_t value = 0;
  const bool is_good = absl::SimpleAtoi(word, &value) && value <= kMaxExact && value >= -kMaxExact;
  base::StoreLittleEndian(static_cast<double>(value), out);
  return is_good;
}

class TextSource final : public VolumeSource {
 public:
  TextSource(const volume::GridGeometry& geometry, TextLocation location, const std::string& name,
             std::unique_ptr<io::RandomAccessFile> file)
      : VolumeSource(
            {.name = name,
             .geometry = geometry,
             .type = location.wide.has_value() ? volume::ScalarType::kFloat64 : location.type,
             .is_seekable = false,
             .memory_bytes = 64 * base::kKiB}),
        location_(std::move(location)),
        file_(std::move(file)),
        scanner_(file_.get(), location_.offset) {}

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    const math::Index3& dims = info().geometry.sample_dims;
    ISOSCOPE_CHECK(begin_row >= 0 && begin_row < end_row && end_row <= dims.y * dims.z);
    const std::int64_t begin = begin_row * dims.x * location_.components + location_.component;
    const std::int64_t count = (end_row - begin_row) * dims.x;
    if (begin < next_number_) {
      scanner_ = TextScanner(file_.get(), location_.offset);
      next_number_ = 0;
      is_at_tag_ = false;
    }
    ISOSCOPE_RETURN_IF_ERROR(Skip(begin - next_number_));
    if (location_.wide.has_value()) {
      return Parse(count, 8, out, ParseWide);
    }
    return volume::VisitScalarType(
        location_.type, [&]<typename T>() { return Parse(count, sizeof(T), out, ParseSample<T>); });
  }

 private:
  template <typename ParseWord>
  absl::Status Parse(std::int64_t count, std::size_t size, char* out, ParseWord parse) {
    for (std::int64_t i = 0; i < count; ++i, out += size) {
      ISOSCOPE_RETURN_IF_ERROR(Skip(i == 0 ? 0 : location_.components - 1));
      ISOSCOPE_ASSIGN_OR_RETURN(const absl::string_view word, Next());
      if (!parse(word, out)) {
        return NoNumber(word);
      }
    }
    return absl::OkStatus();
  }

  absl::Status Skip(std::int64_t count) {
    for (; count > 0; --count) {
      ISOSCOPE_RETURN_IF_ERROR(Next().status());
    }
    return absl::OkStatus();
  }

  absl::StatusOr<absl::string_view> Next() {
    auto word = is_at_tag_ ? absl::StatusOr<absl::string_view>("") : scanner_.NextWord();
    if (word.ok() && location_.ends_at_tag) {
      const std::size_t tag = word->find('<');
      is_at_tag_ = is_at_tag_ || tag != absl::string_view::npos;
      word = word->substr(0, tag);
    }
    if (word.ok() && word->empty()) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: the text ends after %d numbers; its header promises %d: it is cut; copy it again",
          info().name, next_number_,
          math::Volume(info().geometry.sample_dims) * location_.components));
    }
    ++next_number_;
    return word;
  }

  [[nodiscard]] absl::Status NoNumber(absl::string_view word) const {
    constexpr std::size_t kMaxShown = 40;
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: \"%s\" before offset %d; expected %s", info().name,
                        word.substr(0, kMaxShown), scanner_.position(),
                        location_.wide.has_value()
                            ? "an integer up to 2^53 = 9007199254740992, because float64 holds it"
                            : absl::StrCat("a number of type ", volume::NameOf(location_.type))));
  }

  const TextLocation location_;
  const std::unique_ptr<io::RandomAccessFile> file_;
  TextScanner scanner_;
  std::int64_t next_number_ = 0;  // since the offset
  bool is_at_tag_ = false;        // where the numbers end
};

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSource>> MakeTextSource(const volume::GridGeometry& geometry,
                                                             const TextLocation& location,
                                                             const std::string& name) {
  const absl::Status valid = volume::Validate(geometry);
  if (!valid.ok()) {
    return absl::Status(valid.code(), absl::StrCat(name, ": ", valid.message()));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<io::RandomAccessFile> file,
                            io::OpenRandomAccessFile(location.file));
  // Each number has a digit and a break behind it.
  const std::int64_t samples = math::Volume(geometry.sample_dims);
  const std::int64_t most = (file->size_bytes() - location.offset + 1) / 2;
  if (samples > most / location.components) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: %d samples of %d components as text can't stand in %d bytes: the file is cut", name,
        samples, location.components, file->size_bytes() - location.offset));
  }
  return std::make_unique<TextSource>(geometry, location, name, std::move(file));
}

}  // namespace isoscope::source
