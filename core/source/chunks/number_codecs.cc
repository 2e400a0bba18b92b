// Codecs that compute with numbers: delta, fixedscaleoffset and astype of numcodecs, scale_offset
// and cast_value of Zarr 3. In Zarr 3 they encode arrays. In Zarr 2 they are filters, which encode
// bytes; then their configuration alone says which numbers these are, and in which byte order.
//
// numcodecs computes as NumPy does. A quotient of integers is a double, and what a double loses on
// its way to an integer type is cut towards zero. Where NumPy would wrap around, we fail: no chunk
// that was encoded without loss does so.

#include <cmath>
#include <cstddef>
#include <limits>
#include <memory>
#include <optional>
#include <type_traits>
#include <utility>

#include "absl/functional/any_invocable.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/source/bytes/byte_order.h"
#include "core/source/chunks/chunk_codec.h"

namespace isoscope::source {
namespace {

using Numbers = absl::StatusOr<std::string>;
using MadeCodec = absl::StatusOr<std::unique_ptr<ChunkCodec>>;

// Numbers that are stored become those of the chunk.
class NumberCodec final : public ChunkCodec {
 public:
  // Both little-endian.
  using Convert = absl::AnyInvocable<Numbers(const std::string& stored) const>;
  NumberCodec(StoredNumber decoded, StoredNumber encoded, Convert convert)
      : decoded_(decoded), encoded_(encoded), convert_(std::move(convert)) {}

  [[nodiscard]] Numbers Decode(std::string encoded) const override {
    Swap(encoded_, &encoded);
    ISOSCOPE_ASSIGN_OR_RETURN(std::string numbers, convert_(encoded));
    Swap(decoded_, &numbers);
    return numbers;
  }

 private:
  static void Swap(const StoredNumber& number, std::string* bytes) {
    if (number.is_big_endian) {
      SwapBytes(SizeOf(number.type), bytes->size() / SizeOf(number.type), bytes->data());
    }
  }

  const StoredNumber decoded_;
  const StoredNumber encoded_;
  const Convert convert_;
};

// ---- Types of the configuration. ----------------------------------------------------------------

absl::StatusOr<StoredNumber> NumpyTypeIn(const ChunkJson& configuration, const char* name,
                                         std::optional<StoredNumber> otherwise) {
  const auto found = configuration.find(name);
  if ((found == configuration.end() || found->is_null()) && otherwise.has_value()) {
    return *otherwise;
  }
  if (found == configuration.end() || !found->is_string()) {
    return absl::InvalidArgumentError(absl::StrFormat("its %s is no text such as \"<u2\"", name));
  }
  auto type = ParseNumpyType(found->get_ref<const std::string&>());
  return type.ok() ? type
                   : absl::InvalidArgumentError(
                         absl::StrFormat("its %s: %s", name, type.status().message()));
}

absl::StatusOr<double> NumberIn(const ChunkJson& configuration, const char* name) {
  const auto found = configuration.find(name);
  if (found == configuration.end() || !found->is_number() || !std::isfinite(found->get<double>())) {
    return absl::InvalidArgumentError(absl::StrFormat("its %s is no finite number", name));
  }
  return found->get<double>();
}

// What is encoded has the type `decoded`, and becomes as many numbers of the type `encoded`.
absl::Status ChangeType(StoredNumber* decoded, StoredNumber* encoded, ChunkData* data) {
  if (data->is_array) {  // byte orders are those of the machine
    if (data->type != decoded->type) {
      return absl::InvalidArgumentError(absl::StrFormat("it encodes %s, and is given %s",
                                                        NameOf(decoded->type), NameOf(data->type)));
    }
    decoded->is_big_endian = false;
    encoded->is_big_endian = false;
    data->type = encoded->type;
    data->fill.clear();
  }
  const auto from = static_cast<std::int64_t>(SizeOf(decoded->type));
  const auto to = static_cast<std::int64_t>(SizeOf(encoded->type));
  if (data->size_bytes % from != 0 || !data->is_exact) {
    return absl::InvalidArgumentError(
        absl::StrFormat("it encodes %s, and is given %s%d bytes", NameOf(decoded->type),
                        data->is_exact ? "" : "up to ", data->size_bytes));
  }
  data->size_bytes = data->size_bytes / from * to;
  return absl::OkStatus();
}

absl::Status NoHalves(const StoredNumber& a, const StoredNumber& b) {
  return a.type == NumberType::kFloat16 || b.type == NumberType::kFloat16
             ? absl::InvalidArgumentError("it computes with float16; expected other types")
             : absl::OkStatus();
}

// `function`.operator()<Decoded, Encoded>()
template <typename Function>
decltype(auto) VisitTypes(NumberType decoded, NumberType encoded, Function&& function) {
  return VisitNumberType(decoded, [&]<typename Decoded>() {
    return VisitNumberType(encoded, [&]<typename Encoded>() {
      return function.template operator()<Decoded, Encoded>();
    });
  });
}

// ---- Casts. -------------------------------------------------------------------------------------

enum class Rounding { kNearestEven, kTowardsZero, kUp, kDown, kNearestAway };
enum class OutOfRange { kError, kClamp, kWrap };

double Rounded(double value, Rounding rounding) {
  switch (rounding) {
    case Rounding::kNearestEven:
      return std::nearbyint(value);
    case Rounding::kTowardsZero:
      return std::trunc(value);
    case Rounding::kUp:
      return std::ceil(value);
    case Rounding::kDown:
      return std::floor(value);
    case Rounding::kNearestAway:
      return std::round(value);
  }
  return value;
}

// The first double beyond the largest integer of the type.
template <typename Integer>
double EndOf() {
  return std::ldexp(1.0, std::numeric_limits<Integer>::digits);
}

// Returns false if the value has none.
template <typename Out, typename In>
bool CastNumber(In value, Rounding rounding, OutOfRange out_of_range, Out* out) {
  if constexpr (std::is_floating_point_v<Out>) {
    *out = static_cast<Out>(value);  // beyond the range: infinite, as IEEE 754 rounds
    return true;
  } else if constexpr (std::is_floating_point_v<In>) {
    if (std::isnan(value)) {
      return false;
    }
    const double rounded = Rounded(static_cast<double>(value), rounding);
    const auto least = static_cast<double>(std::numeric_limits<Out>::lowest());
    if (rounded >= least && rounded < EndOf<Out>()) {
      *out = static_cast<Out>(rounded);
      return true;
    }
    if (out_of_range == OutOfRange::kClamp) {
      *out = rounded < least ? std::numeric_limits<Out>::lowest() : std::numeric_limits<Out>::max();
      return true;
    }
    if (out_of_range == OutOfRange::kWrap && std::isfinite(rounded)) {
      const double modulus = std::ldexp(1.0, 8 * static_cast<int>(sizeof(Out)));
      double rest = std::fmod(rounded, modulus);
      rest = rest < 0 ? rest + modulus : rest;
      *out = static_cast<Out>(static_cast<std::uint64_t>(rest >= modulus ? 0 : rest));
      return true;
    }
    return false;
  } else {
    // NOLINTNEXTLINE(bugprone-signed-char-misuse): an int8 is a number, no character
    const auto cast = static_cast<Out>(value);
    const bool is_same = static_cast<In>(cast) == value && ((cast < Out{0}) == (value < In{0}));
    if (is_same || out_of_range == OutOfRange::kWrap) {
      *out = cast;
      return true;
    }
    *out = value < In{0} ? std::numeric_limits<Out>::lowest() : std::numeric_limits<Out>::max();
    return out_of_range == OutOfRange::kClamp;
  }
}

template <typename T>
absl::Status NoSuchNumber(T value, std::size_t i, NumberType type) {
  return absl::DataLossError(absl::StrFormat("%g, number %d of the chunk, is no %s",
                                             static_cast<double>(value), i, NameOf(type)));
}

struct Casting {
  NumberType decoded = NumberType::kUint8;
  NumberType encoded = NumberType::kUint8;
  Rounding rounding = Rounding::kNearestEven;
  OutOfRange out_of_range = OutOfRange::kError;
  // Stored numbers that mean others: bytes of both. They go before the cast.
  std::vector<std::pair<std::string, std::string>> exceptions{};
};

// `stored` is one of those, bit by bit; a NaN is every NaN.
template <typename T>
bool IsSameNumber(T stored, const std::string& bytes) {
  const auto other = base::LoadLittleEndian<T>(bytes.data());
  if constexpr (std::is_floating_point_v<T>) {
    if (std::isnan(stored) && std::isnan(other)) {
      return true;
    }
  }
  return stored == other;
}

template <typename Decoded, typename Encoded>
Numbers CastAll(const Casting& casting, const std::string& stored) {
  const std::size_t count = stored.size() / sizeof(Encoded);
  std::string out(count * sizeof(Decoded), '\0');
  for (std::size_t i = 0; i < count; ++i) {
    const auto value = base::LoadLittleEndian<Encoded>(stored.data() + i * sizeof(Encoded));
    Decoded number{};
    bool is_known = false;
    for (const auto& [from, to] : casting.exceptions) {
      if (IsSameNumber(value, from)) {
        number = base::LoadLittleEndian<Decoded>(to.data());
        is_known = true;
        break;
      }
    }
    if (!is_known && !CastNumber(value, casting.rounding, casting.out_of_range, &number)) {
      return NoSuchNumber(value, i, casting.decoded);
    }
    base::StoreLittleEndian(number, out.data() + i * sizeof(Decoded));
  }
  return out;
}

MadeCodec MakeCasting(StoredNumber decoded, StoredNumber encoded, Casting casting) {
  ISOSCOPE_RETURN_IF_ERROR(decoded.type == encoded.type ? absl::OkStatus()
                                                        : NoHalves(decoded, encoded));
  casting.decoded = decoded.type;
  casting.encoded = encoded.type;
  return std::make_unique<NumberCodec>(
      decoded, encoded, [casting = std::move(casting)](const std::string& stored) -> Numbers {
        return VisitTypes(casting.decoded, casting.encoded,
                          [&]<typename Decoded, typename Encoded>() {
                            return CastAll<Decoded, Encoded>(casting, stored);
                          });
      });
}

// numcodecs' names: what is encoded from is `decode_dtype`.
MadeCodec MakeAsType(const ChunkJson& configuration, ChunkData* data) {
  ISOSCOPE_ASSIGN_OR_RETURN(StoredNumber decoded,
                            NumpyTypeIn(configuration, "decode_dtype", std::nullopt));
  ISOSCOPE_ASSIGN_OR_RETURN(StoredNumber encoded,
                            NumpyTypeIn(configuration, "encode_dtype", std::nullopt));
  ISOSCOPE_RETURN_IF_ERROR(ChangeType(&decoded, &encoded, data));
  return MakeCasting(decoded, encoded, {.rounding = Rounding::kTowardsZero});
}

template <typename Choice>
absl::StatusOr<Choice> ChoiceIn(const ChunkJson& configuration, const char* name,
                                const std::vector<std::pair<const char*, Choice>>& choices) {
  const auto found = configuration.find(name);
  if (found == configuration.end() || found->is_null()) {
    return choices.front().second;
  }
  std::string names;
  for (const auto& [text, choice] : choices) {
    if (*found == text) {
      return choice;
    }
    absl::StrAppend(&names, names.empty() ? "" : ", ", text);
  }
  return absl::InvalidArgumentError(absl::StrFormat("its %s is none of %s", name, names));
}

absl::Status TakeExceptions(const ChunkJson& configuration, NumberType decoded, NumberType encoded,
                            Casting* casting) {
  const auto map = configuration.find("scalar_map");
  if (map == configuration.end() || map->is_null()) {
    return absl::OkStatus();
  }
  constexpr std::size_t kMaxExceptions = 1024;
  const bool is_object = map->is_object();
  const auto list = is_object ? map->find("decode") : map->end();
  if (!is_object || (list != map->end() && (!list->is_array() || list->size() > kMaxExceptions))) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "its scalar_map has no list \"decode\" of at most %d pairs", kMaxExceptions));
  }
  for (std::size_t i = 0; list != map->end() && i < list->size(); ++i) {
    const ChunkJson& pair = (*list)[i];
    if (!pair.is_array() || pair.size() != 2) {
      return absl::InvalidArgumentError("its scalar_map has an entry that is no pair");
    }
    ISOSCOPE_ASSIGN_OR_RETURN(std::string from, NumberBytes(pair[0], encoded));
    ISOSCOPE_ASSIGN_OR_RETURN(std::string to, NumberBytes(pair[1], decoded));
    casting->exceptions.emplace_back(std::move(from), std::move(to));
  }
  return absl::OkStatus();
}

absl::Status CheckMembers(const ChunkJson& configuration, const std::vector<std::string>& known) {
  for (const auto& item : configuration.items()) {
    if (std::find(known.begin(), known.end(), item.key()) == known.end()) {
      constexpr std::size_t kMaxShown = 60;
      return absl::InvalidArgumentError(absl::StrFormat("\"%s\" in its configuration is unknown",
                                                        item.key().substr(0, kMaxShown)));
    }
  }
  return absl::OkStatus();
}

absl::Status CheckIsNumbers(const ChunkData& data) {
  return data.is_array ? absl::OkStatus()
                       : absl::InvalidArgumentError(
                             "encodes numbers, and a codec in front of it has made bytes of them");
}

MadeCodec MakeCastValue(const ChunkJson& configuration, ChunkData* data) {
  ISOSCOPE_RETURN_IF_ERROR(CheckIsNumbers(*data));
  ISOSCOPE_RETURN_IF_ERROR(
      CheckMembers(configuration, {"data_type", "rounding", "out_of_range", "scalar_map"}));
  const auto name = configuration.find("data_type");
  const auto type = name != configuration.end() && name->is_string()
                        ? NumberTypeFromName(name->get_ref<const std::string&>())
                        : std::nullopt;
  if (!type.has_value()) {
    return absl::InvalidArgumentError("its data_type is no type of numbers");
  }
  Casting casting;
  ISOSCOPE_ASSIGN_OR_RETURN(casting.rounding,
                            (ChoiceIn<Rounding>(configuration, "rounding",
                                                {{"nearest-even", Rounding::kNearestEven},
                                                 {"towards-zero", Rounding::kTowardsZero},
                                                 {"towards-positive", Rounding::kUp},
                                                 {"towards-negative", Rounding::kDown},
                                                 {"nearest-away", Rounding::kNearestAway}})));
  ISOSCOPE_ASSIGN_OR_RETURN(casting.out_of_range,
                            (ChoiceIn<OutOfRange>(configuration, "out_of_range",
                                                  {{"error", OutOfRange::kError},
                                                   {"clamp", OutOfRange::kClamp},
                                                   {"wrap", OutOfRange::kWrap}})));
  StoredNumber decoded{.type = data->type};
  StoredNumber encoded{.type = *type};
  ISOSCOPE_RETURN_IF_ERROR(TakeExceptions(configuration, decoded.type, encoded.type, &casting));
  ISOSCOPE_RETURN_IF_ERROR(ChangeType(&decoded, &encoded, data));
  return MakeCasting(decoded, encoded, std::move(casting));
}

// ---- Delta: each number but the first is the difference to the one before. ----------------------

template <typename Decoded, typename Encoded>
Numbers AddUp(NumberType type, const std::string& stored) {
  const std::size_t count = stored.size() / sizeof(Encoded);
  std::string out(count * sizeof(Decoded), '\0');
  Decoded sum{};
  for (std::size_t i = 0; i < count; ++i) {
    const auto value = base::LoadLittleEndian<Encoded>(stored.data() + i * sizeof(Encoded));
    Decoded difference{};
    if (!CastNumber(value, Rounding::kTowardsZero, OutOfRange::kWrap, &difference)) {
      return NoSuchNumber(value, i, type);
    }
    if constexpr (std::is_integral_v<Decoded>) {  // around the end of the type, as it was encoded
      sum = static_cast<Decoded>(static_cast<std::uint64_t>(sum) +
                                 static_cast<std::uint64_t>(difference));
    } else {
      sum = i == 0 ? difference : sum + difference;
    }
    base::StoreLittleEndian(sum, out.data() + i * sizeof(Decoded));
  }
  return out;
}

MadeCodec MakeDelta(const ChunkJson& configuration, ChunkData* data) {
  ISOSCOPE_ASSIGN_OR_RETURN(StoredNumber decoded,
                            NumpyTypeIn(configuration, "dtype", std::nullopt));
  ISOSCOPE_ASSIGN_OR_RETURN(StoredNumber encoded, NumpyTypeIn(configuration, "astype", decoded));
  ISOSCOPE_RETURN_IF_ERROR(NoHalves(decoded, encoded));
  if (decoded.type == NumberType::kBool || encoded.type == NumberType::kBool) {
    return absl::InvalidArgumentError("differences of bool; expected numbers");
  }
  ISOSCOPE_RETURN_IF_ERROR(ChangeType(&decoded, &encoded, data));
  return std::make_unique<NumberCodec>(
      decoded, encoded,
      [type = decoded.type, stored_type = encoded.type](const std::string& stored) -> Numbers {
        return VisitTypes(type, stored_type, [&]<typename Decoded, typename Encoded>() {
          return AddUp<Decoded, Encoded>(type, stored);
        });
      });
}

// ---- Scale and offset. --------------------------------------------------------------------------

// NumPy's quotient of a float32 and a number is a float32, that of all others a double.
template <typename Decoded, typename Encoded>
Numbers Unscale(double offset, double scale, NumberType type, const std::string& stored) {
  using Real = std::conditional_t<std::is_same_v<Encoded, float>, float, double>;
  const std::size_t count = stored.size() / sizeof(Encoded);
  std::string out(count * sizeof(Decoded), '\0');
  for (std::size_t i = 0; i < count; ++i) {
    const auto value = base::LoadLittleEndian<Encoded>(stored.data() + i * sizeof(Encoded));
    const Real number =
        static_cast<Real>(value) / static_cast<Real>(scale) + static_cast<Real>(offset);
    Decoded decoded{};
    if (!CastNumber(number, Rounding::kTowardsZero, OutOfRange::kError, &decoded)) {
      return NoSuchNumber(number, i, type);
    }
    base::StoreLittleEndian(decoded, out.data() + i * sizeof(Decoded));
  }
  return out;
}

MadeCodec MakeFixedScaleOffset(const ChunkJson& configuration, ChunkData* data) {
  ISOSCOPE_ASSIGN_OR_RETURN(StoredNumber decoded,
                            NumpyTypeIn(configuration, "dtype", std::nullopt));
  ISOSCOPE_ASSIGN_OR_RETURN(StoredNumber encoded, NumpyTypeIn(configuration, "astype", decoded));
  ISOSCOPE_ASSIGN_OR_RETURN(const double offset, NumberIn(configuration, "offset"));
  ISOSCOPE_ASSIGN_OR_RETURN(const double scale, NumberIn(configuration, "scale"));
  ISOSCOPE_RETURN_IF_ERROR(NoHalves(decoded, encoded));
  if (scale == 0) {
    return absl::InvalidArgumentError("its scale is 0");
  }
  ISOSCOPE_RETURN_IF_ERROR(ChangeType(&decoded, &encoded, data));
  return std::make_unique<NumberCodec>(
      decoded, encoded,
      [offset, scale, type = decoded.type,
       stored_type = encoded.type](const std::string& stored) -> Numbers {
        return VisitTypes(type, stored_type, [&]<typename Decoded, typename Encoded>() {
          return Unscale<Decoded, Encoded>(offset, scale, type, stored);
        });
      });
}

// stored / scale + offset in the type itself. Integers must divide without a rest.
template <typename T>
Numbers UnscaleExactly(const std::string& offset_bytes, const std::string& scale_bytes,
                       NumberType type, const std::string& stored) {
  const auto offset = base::LoadLittleEndian<T>(offset_bytes.data());
  const auto scale = base::LoadLittleEndian<T>(scale_bytes.data());
  const std::size_t count = stored.size() / sizeof(T);
  std::string out(stored.size(), '\0');
  for (std::size_t i = 0; i < count; ++i) {
    const auto value = base::LoadLittleEndian<T>(stored.data() + i * sizeof(T));
    T number{};
    if constexpr (std::is_integral_v<T>) {
      const bool overflows = std::is_signed_v<T> && static_cast<std::int64_t>(scale) == -1 &&
                             value == std::numeric_limits<T>::lowest();
      if (overflows || value % scale != 0 ||
          __builtin_add_overflow(static_cast<T>(value / scale), offset, &number)) {
        return NoSuchNumber(value, i, type);
      }
    } else {
      number = value / scale + offset;
    }
    base::StoreLittleEndian(number, out.data() + i * sizeof(T));
  }
  return out;
}

MadeCodec MakeScaleOffset(const ChunkJson& configuration, ChunkData* data) {
  ISOSCOPE_RETURN_IF_ERROR(CheckIsNumbers(*data));
  ISOSCOPE_RETURN_IF_ERROR(CheckMembers(configuration, {"offset", "scale"}));
  const StoredNumber number{.type = data->type};
  ISOSCOPE_RETURN_IF_ERROR(NoHalves(number, number));
  if (data->type == NumberType::kBool) {
    return absl::InvalidArgumentError("it computes with bool; expected numbers");
  }
  // Both may be left out where they change nothing.
  ISOSCOPE_ASSIGN_OR_RETURN(std::string offset,
                            NumberBytes(configuration.value("offset", ChunkJson(0)), data->type));
  ISOSCOPE_ASSIGN_OR_RETURN(std::string scale,
                            NumberBytes(configuration.value("scale", ChunkJson(1)), data->type));
  const bool is_zero = VisitNumberType(
      data->type, [&]<typename T>() { return base::LoadLittleEndian<T>(scale.data()) == T{0}; });
  if (is_zero) {
    return absl::InvalidArgumentError("its scale is 0");
  }
  data->fill.clear();
  return std::make_unique<NumberCodec>(number, number,
                                       [offset = std::move(offset), scale = std::move(scale),
                                        type = data->type](const std::string& stored) -> Numbers {
                                         return VisitNumberType(type, [&]<typename T>() {
                                           return UnscaleExactly<T>(offset, scale, type, stored);
                                         });
                                       });
}

// Rounds when it encodes, and leaves numbers as they are when it decodes.
MadeCodec MakeRounding(const ChunkJson& configuration, ChunkData* data) {
  if (!configuration.contains("dtype")) {  // "bitround"
    const StoredNumber number{.type = data->type};
    return MakeCasting(number, number, {});
  }
  ISOSCOPE_ASSIGN_OR_RETURN(StoredNumber decoded,
                            NumpyTypeIn(configuration, "dtype", std::nullopt));
  ISOSCOPE_ASSIGN_OR_RETURN(StoredNumber encoded, NumpyTypeIn(configuration, "astype", decoded));
  ISOSCOPE_RETURN_IF_ERROR(ChangeType(&decoded, &encoded, data));
  return MakeCasting(decoded, encoded, {});
}

}  // namespace

absl::Span<const CodecRow> NumberCodecs() {
  static constexpr CodecRow kRows[] = {
      {"astype", MakeAsType},
      {"bitround", MakeRounding},
      {"cast_value", MakeCastValue},
      {"delta", MakeDelta},
      {"fixedscaleoffset", MakeFixedScaleOffset},
      {"quantize", MakeRounding},
      {"scale_offset", MakeScaleOffset},
  };
  return kRows;
}

}  // namespace isoscope::source
