// A pixel has BitsAllocated (0028,0100) bits. Its value is in BitsStored (0028,0101) of them, of
// which HighBit (0028,0102) is the highest. The others have no meaning; old files keep overlays
// there. A signed value in 12 of 16 bits:
//
//   bits allocated   xxxx svvv vvvv vvvv      x: no meaning; s: sign; high bit: 11
//   clean            ssss svvv vvvv vvvv
//
// MONOCHROME1 (0028,0004) says that small values are bright on a screen. So do the shape of a
// presentation table and windows. None of them changes a value.
// Source: DICOM PS3.3, sections C.7.6.3 and C.11.1; PS3.5, section 8.1.1.

#include "core/formats/dicom/dicom_values.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <type_traits>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/coding.h"

namespace isoscope::source {
namespace {

using volume::ScalarType;

struct Interval {
  double min = 0;
  double max = 0;
};

// The values that stored bits can have.
Interval StoredInterval(const DicomPixels& pixels) {
  const double count = std::ldexp(1, static_cast<int>(pixels.bits_stored));
  return pixels.is_signed ? Interval{-count / 2, count / 2 - 1} : Interval{0, count - 1};
}

Interval SampleInterval(const DicomValues& slice) {
  const Interval stored = StoredInterval(slice.pixels);
  const double a = slice.rescaling.slope * stored.min + slice.rescaling.intercept;
  const double b = slice.rescaling.slope * stored.max + slice.rescaling.intercept;
  return {std::min(a, b), std::max(a, b)};
}

bool IsWhole(const Rescaling& rescaling) {
  return std::floor(rescaling.slope) == rescaling.slope &&
         std::floor(rescaling.intercept) == rescaling.intercept;
}

template <typename T>
bool Holds(const Interval& samples, std::int64_t least_bits) {
  return least_bits <= static_cast<std::int64_t>(8 * sizeof(T)) &&
         samples.min >= static_cast<double>(std::numeric_limits<T>::min()) &&
         samples.max <= static_cast<double>(std::numeric_limits<T>::max());
}

// float64 if none of 32 bits holds them.
ScalarType IntegerType(const Interval& samples, std::int64_t least_bits) {
  if (samples.min >= 0) {
    return Holds<std::uint8_t>(samples, least_bits)    ? ScalarType::kUint8
           : Holds<std::uint16_t>(samples, least_bits) ? ScalarType::kUint16
           : Holds<std::uint32_t>(samples, least_bits) ? ScalarType::kUint32
                                                       : ScalarType::kFloat64;
  }
  return Holds<std::int8_t>(samples, least_bits)    ? ScalarType::kInt8
         : Holds<std::int16_t>(samples, least_bits) ? ScalarType::kInt16
         : Holds<std::int32_t>(samples, least_bits) ? ScalarType::kInt32
                                                    : ScalarType::kFloat64;
}

template <typename Stored>
void Clean(const DicomPixels& pixels, std::size_t count, char* stored) {
  constexpr auto kBits = static_cast<std::int64_t>(8 * sizeof(Stored));
  using Bits = std::make_unsigned_t<Stored>;
  const auto drop = static_cast<int>(kBits - 1 - pixels.high_bit);
  const auto shift = static_cast<int>(kBits - pixels.bits_stored);
  for (std::size_t i = 0; i < count; ++i) {
    char* const at = stored + i * sizeof(Stored);
    const auto top = static_cast<Bits>(base::LoadLittleEndian<Bits>(at) << drop);
    base::StoreLittleEndian(static_cast<Stored>(static_cast<Stored>(top) >> shift), at);
  }
}

template <typename Stored, typename Sample>
void Write(const Rescaling& rescaling, std::size_t count, const char* stored, char* out) {
  for (std::size_t i = 0; i < count; ++i) {
    const auto pixel =
        static_cast<double>(base::LoadLittleEndian<Stored>(stored + i * sizeof(Stored)));
    base::StoreLittleEndian(static_cast<Sample>(pixel * rescaling.slope + rescaling.intercept),
                            out + i * sizeof(Sample));
  }
}

}  // namespace

absl::Status CheckDicomPixels(const DicomPixels& pixels, DicomPhotometric photometric) {
  if (photometric == DicomPhotometric::kPalette) {
    return absl::InvalidArgumentError(
        "its pixels are indices of a palette (a colour image); expected greyscale");
  }
  if (pixels.components != 1 || photometric == DicomPhotometric::kColour) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%d components a sample (a colour image); expected greyscale", pixels.components));
  }
  if (photometric == DicomPhotometric::kOther) {
    return absl::InvalidArgumentError(
        "its photometric interpretation (0028,0004) is not known; expected MONOCHROME1 or "
        "MONOCHROME2");
  }
  if (pixels.width < 1 || pixels.height < 1) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%d x %d pixels", pixels.width, pixels.height));
  }
  const bool is_type =
      pixels.bits_allocated == 8 || pixels.bits_allocated == 16 || pixels.bits_allocated == 32;
  if (!is_type || pixels.bits_stored < 1 || pixels.bits_stored > pixels.high_bit + 1 ||
      pixels.high_bit >= pixels.bits_allocated) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "pixels with %d bits stored below bit %d of %d allocated (0028,0101, 0102 and 0100); "
        "expected greyscale integers in 8, 16 or 32 bits",
        pixels.bits_stored, pixels.high_bit, pixels.bits_allocated));
  }
  return absl::OkStatus();
}

ScalarType DicomStoredType(const DicomPixels& pixels) {
  switch (pixels.bits_allocated) {
    case 8:
      return pixels.is_signed ? ScalarType::kInt8 : ScalarType::kUint8;
    case 16:
      return pixels.is_signed ? ScalarType::kInt16 : ScalarType::kUint16;
    default:
      return pixels.is_signed ? ScalarType::kInt32 : ScalarType::kUint32;
  }
}

ScalarType DicomSampleType(const std::vector<DicomValues>& slices) {
  const ScalarType first = DicomStoredType(slices.front().pixels);
  bool is_stored = true;
  bool is_whole = true;
  bool has_image = false;  // a file of one
  std::int64_t bits = 0;
  Interval samples = SampleInterval(slices.front());
  for (const DicomValues& slice : slices) {
    is_stored =
        is_stored && slice.rescaling == Rescaling{} && DicomStoredType(slice.pixels) == first;
    is_whole = is_whole && IsWhole(slice.rescaling);
    has_image = has_image || !slice.is_frame;
    bits = std::max(bits, slice.pixels.bits_allocated);
    const Interval own = SampleInterval(slice);
    samples = {std::min(samples.min, own.min), std::max(samples.max, own.max)};
  }
  if (is_stored) {
    return first;
  }
  if (is_whole && has_image) {
    return IntegerType(samples, bits);
  }
  return has_image || bits > 16 ? ScalarType::kFloat64 : ScalarType::kFloat32;
}

void CleanDicomPixels(const DicomPixels& pixels, std::size_t count, char* stored) {
  if (pixels.bits_stored == pixels.bits_allocated) {
    return;
  }
  volume::VisitScalarType(DicomStoredType(pixels), [&]<typename Stored>() {
    if constexpr (std::is_integral_v<Stored>) {
      Clean<Stored>(pixels, count, stored);
    }
  });
}

void WriteDicomSamples(const DicomValues& values, ScalarType type, std::size_t count,
                       const char* stored, char* out) {
  const ScalarType stored_type = DicomStoredType(values.pixels);
  if (stored_type == type && values.rescaling == Rescaling{}) {
    if (stored != out) {
      std::copy_n(stored, count * volume::SizeOf(type), out);
    }
    return;
  }
  volume::VisitScalarType(stored_type, [&]<typename Stored>() {
    volume::VisitScalarType(type, [&]<typename Sample>() {
      if constexpr (std::is_integral_v<Stored>) {
        Write<Stored, Sample>(values.rescaling, count, stored, out);
      }
    });
  });
}

}  // namespace isoscope::source
