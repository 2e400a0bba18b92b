#include "core/source/adapt/wide_source.h"

#include <bit>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>

#include "absl/functional/function_ref.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/status_macros.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxExact = std::int64_t{1} << 53;

// In place. Returns the index of the first value that is out of range, else `count`.
template <typename Integer>
std::size_t WidenIntegers(std::size_t count, char* samples) {
  for (std::size_t i = 0; i < count; ++i) {
    const auto value = base::LoadLittleEndian<Integer>(samples + i * sizeof(Integer));
    bool is_exact = value <= static_cast<Integer>(kMaxExact);
    if constexpr (std::is_signed_v<Integer>) {
      is_exact = is_exact && value >= -kMaxExact;
    }
    if (!is_exact) {
      return i;
    }
    base::StoreLittleEndian(static_cast<double>(value), samples + i * sizeof(double));
  }
  return count;
}

// The value of an IEEE 754 binary16: sign, 5 bits of exponent, 10 of fraction.
float HalfValue(std::uint16_t half) {
  constexpr std::uint32_t kInfinityExponent = 0xffU << 23;
  const std::uint32_t sign = static_cast<std::uint32_t>(half & 0x8000U) << 16;
  const std::uint32_t exponent = (half >> 10) & 0x1fU;
  const std::uint32_t fraction = half & 0x3ffU;
  if (exponent == 0) {  // zero, or fraction * 2^-24
    const float magnitude = static_cast<float>(fraction) * 0x1p-24F;
    return std::bit_cast<float>(std::bit_cast<std::uint32_t>(magnitude) | sign);
  }
  const std::uint32_t wide = exponent == 0x1f ? kInfinityExponent : (exponent + 127 - 15) << 23;
  return std::bit_cast<float>(sign | wide | (fraction << 13));
}

class WideSource final : public VolumeSource {
 public:
  WideSource(std::unique_ptr<VolumeSource> stored, WideType type)
      : VolumeSource(InfoOf(stored->info(), type)), stored_(std::move(stored)), type_(type) {}

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    const std::int64_t rows = info().geometry.sample_dims.y;
    return ReadWide(
        end_row - begin_row, out,
        [&](char* stored) { return stored_->ReadRows(begin_row, end_row, stored); },
        [&](std::int64_t row) {
          return math::Index3{0, (begin_row + row) % rows, (begin_row + row) / rows};
        });
  }

  absl::Status ReadBand(std::int64_t begin_z, std::int64_t end_z, std::int64_t begin_y,
                        std::int64_t end_y, char* out) override {
    const std::int64_t rows = end_y - begin_y;
    return ReadWide(
        (end_z - begin_z) * rows, out,
        [&](char* stored) { return stored_->ReadBand(begin_z, end_z, begin_y, end_y, stored); },
        [&](std::int64_t row) {
          return math::Index3{0, begin_y + row % rows, begin_z + row / rows};
        });
  }

  void HeedCancellation(const base::Cancellation* cancellation) override {
    stored_->HeedCancellation(cancellation);
  }

  [[nodiscard]] std::optional<BoxGrid> box_grid() const override { return stored_->box_grid(); }
  [[nodiscard]] std::int64_t decoding_factor() const override { return stored_->decoding_factor(); }
  [[nodiscard]] absl::Status ReadBox(const math::IndexBox& box, char* out,
                                     const base::Cancellation& cancellation) const override {
    const math::Index3 dims = box.dims();
    const auto count = static_cast<std::size_t>(math::Volume(dims));
    char* const stored = StoredIn(count, out);
    ISOSCOPE_RETURN_IF_ERROR(stored_->ReadBox(box, stored, cancellation));
    const std::size_t widened = Widen(count, stored, out);
    const auto index = static_cast<std::int64_t>(widened);
    return widened == count
               ? absl::OkStatus()
               : OutOfRange({box.begin.x + index % dims.x, box.begin.y + index / dims.x % dims.y,
                             box.begin.z + index / dims.x / dims.y},
                            out + widened * sizeof(double));
  }

 private:
  static SourceInfo InfoOf(SourceInfo info, WideType type) {
    info.type =
        type == WideType::kFloat16 ? volume::ScalarType::kFloat32 : volume::ScalarType::kFloat64;
    return info;
  }
  // Whole rows. `first_of`: the first sample of the i-th one that was read.
  absl::Status ReadWide(std::int64_t rows, char* out, absl::FunctionRef<absl::Status(char*)> read,
                        absl::FunctionRef<math::Index3(std::int64_t)> first_of) const {
    const std::int64_t row_samples = info().geometry.sample_dims.x;
    const auto count = static_cast<std::size_t>(rows * row_samples);
    char* const stored = StoredIn(count, out);
    ISOSCOPE_RETURN_IF_ERROR(read(stored));
    const std::size_t widened = Widen(count, stored, out);
    if (widened == count) {
      return absl::OkStatus();
    }
    const auto index = static_cast<std::int64_t>(widened);
    math::Index3 at = first_of(index / row_samples);
    at.x = index % row_samples;
    return OutOfRange(at, out + widened * sizeof(double));
  }
  // Halves lie in the tail of `out`, so no sample is written over before it was read.
  [[nodiscard]] char* StoredIn(std::size_t count, char* out) const {
    return type_ == WideType::kFloat16 ? out + count * (sizeof(float) - sizeof(std::uint16_t))
                                       : out;
  }
  // Returns the index of the first value that is out of range, else `count`.
  [[nodiscard]] std::size_t Widen(std::size_t count, const char* stored, char* out) const {
    if (type_ == WideType::kInt64) {
      return WidenIntegers<std::int64_t>(count, out);
    }
    if (type_ == WideType::kUint64) {
      return WidenIntegers<std::uint64_t>(count, out);
    }
    for (std::size_t i = 0; i < count; ++i) {
      const auto half = base::LoadLittleEndian<std::uint16_t>(stored + i * 2);
      base::StoreLittleEndian(HalfValue(half), out + i * sizeof(float));
    }
    return count;
  }
  [[nodiscard]] absl::Status OutOfRange(const math::Index3& at, const char* sample) const {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: the sample at (%d, %d, %d) is %s; 64-bit integers are stored as float64, which is "
        "exact up to 2^53 = 9007199254740992 on either side of 0: subtract an offset, or scale it",
        info().name, at.x, at.y, at.z,
        type_ == WideType::kInt64 ? absl::StrCat(base::LoadLittleEndian<std::int64_t>(sample))
                                  : absl::StrCat(base::LoadLittleEndian<std::uint64_t>(sample))));
  }

  const std::unique_ptr<VolumeSource> stored_;
  const WideType type_;
};

}  // namespace

std::optional<WideType> WideTypeFromName(absl::string_view name) {
  if (name == "int64") {
    return WideType::kInt64;
  }
  if (name == "uint64") {
    return WideType::kUint64;
  }
  return name == "float16" ? std::optional<WideType>(WideType::kFloat16) : std::nullopt;
}

volume::ScalarType CarrierType(WideType type) {
  return type == WideType::kFloat16 ? volume::ScalarType::kUint16 : volume::ScalarType::kFloat64;
}

std::unique_ptr<VolumeSource> MakeWideSource(std::unique_ptr<VolumeSource> stored, WideType type) {
  ISOSCOPE_CHECK(stored->info().type == CarrierType(type));
  return std::make_unique<WideSource>(std::move(stored), type);
}

}  // namespace isoscope::source
