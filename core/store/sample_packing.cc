// Packing takes three steps, and unpacking the same in reverse:
//
//   1. Subtract from each plane the one before, then from each row the one before, modulo 2^bits.
//      Rows are added again as vectors; differences along x would make that a chain.
//   2. Zigzag: 0, -1, 1, -2, ... become 0, 1, 2, 3, ...
//   3. Keep of 64 samples each as many bits as the largest of them needs.
//
// A group of 64 samples of W bits is W words of 64 bits, each with 64 / W samples side by side
// (lanes). Shifts and masks of a word treat all its lanes at once. A lane's samples of b bits lie
// one after the other in the same lane of b words, lowest bits first:
//
//   W = 8, b = 3, one lane of 8:   word 0  c c b b b a a a     a: the sample of word 0 of the group,
//                                  word 1  f e e e d d d c     b: of word 1, ...; the lowest bit
//                                  word 2  h h h g g g f f     is on the right
//
// Unpacking reads each sample from one word, or from two. Positions and shifts are constants: there
// is a function for each b.

#include "core/store/sample_packing.h"

#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <utility>
#include <vector>

#include "core/base/check.h"

namespace isoscope::store {
namespace {

static_assert(std::endian::native == std::endian::little);

constexpr std::size_t kGroupSamples = 64;
constexpr std::size_t kWordBytes = sizeof(std::uint64_t);
// Unpacking adds this many bytes of a row at once.
constexpr std::size_t kVectorBytes = 16;

std::uint64_t LoadWord(const char* bytes) {
  std::uint64_t word = 0;
  std::memcpy(&word, bytes, kWordBytes);
  return word;
}
void StoreWord(std::uint64_t word, char* bytes) { std::memcpy(bytes, &word, kWordBytes); }

// Unsigned samples T, and words of their lanes.
template <typename T>
struct Lanes {
  static constexpr std::size_t kBits = 8 * sizeof(T);
  // A word with 1 in every lane.
  static constexpr std::uint64_t kOnes = ~std::uint64_t{0} / static_cast<T>(~T{0});

  // The lowest `count` bits of every lane.
  static constexpr std::uint64_t Mask(std::size_t count) {
    return count == kBits ? ~std::uint64_t{0} : ((std::uint64_t{1} << count) - 1) * kOnes;
  }
  static std::uint64_t UndoZigzag(std::uint64_t word) {
    const std::uint64_t signs = word & kOnes;
    const std::uint64_t negative = (signs << kBits) - signs;  // all ones where the sign is 1
    return ((word >> 1) & Mask(kBits - 1)) ^ negative;
  }
};

template <typename T>
T Zigzag(T value) {
  constexpr int kSignShift = static_cast<int>(8 * sizeof(T)) - 1;
  return static_cast<T>(static_cast<T>(value << 1) ^
                        static_cast<T>(-static_cast<int>(value >> kSignShift)));
}

struct Rows {
  std::size_t x;
  std::size_t y;
  std::size_t z;
  [[nodiscard]] std::size_t plane() const { return x * y; }
  [[nodiscard]] std::size_t count() const { return x * y * z; }
  [[nodiscard]] std::size_t group_count() const {
    return (count() + kGroupSamples - 1) / kGroupSamples;
  }
};

template <typename T>
void Subtract(std::size_t count, const T* subtrahends, T* values) {
  for (std::size_t i = 0; i < count; ++i) {
    values[i] = static_cast<T>(values[i] - subtrahends[i]);
  }
}

// Zigzag differences of all samples; zeros fill the last group.
template <typename T>
std::vector<T> Differences(const Rows& rows, absl::string_view samples) {
  std::vector<T> differences(rows.group_count() * kGroupSamples, T{0});
  std::memcpy(differences.data(), samples.data(), samples.size());
  // From the last plane and row to the first: what is subtracted is not changed yet.
  for (std::size_t plane = rows.count() - rows.plane(); plane > 0; plane -= rows.plane()) {
    Subtract(rows.plane(), differences.data() + plane - rows.plane(), differences.data() + plane);
  }
  for (std::size_t row = rows.count() - rows.x; row > 0; row -= rows.x) {
    if (row % rows.plane() != 0) {
      Subtract(rows.x, differences.data() + row - rows.x, differences.data() + row);
    }
  }
  for (std::size_t i = 0; i < rows.count(); ++i) {
    differences[i] = Zigzag(differences[i]);
  }
  return differences;
}

// Writes `bits` words.
template <typename T>
void PackGroup(const T* values, std::size_t bits, char* out) {
  constexpr std::size_t kLaneBits = Lanes<T>::kBits;
  std::array<std::uint64_t, kLaneBits + 1> packed{};
  for (std::size_t slot = 0; slot < kLaneBits; ++slot) {
    std::uint64_t word = 0;
    std::memcpy(&word, values + slot * (kWordBytes / sizeof(T)), kWordBytes);
    const std::size_t at = slot * bits / kLaneBits;
    const std::size_t shift = slot * bits % kLaneBits;
    const std::size_t low = kLaneBits - shift;  // bits that this word has room for
    packed[at] |= (word & Lanes<T>::Mask(low)) << shift;
    if (bits > low) {
      packed[at + 1] |= (word >> low) & Lanes<T>::Mask(bits - low);
    }
  }
  std::memcpy(out, packed.data(), bits * kWordBytes);
}

template <typename T>
bool Pack(const Rows& rows, absl::string_view samples, std::string* out) {
  const std::vector<T> differences = Differences<T>(rows, samples);
  const std::size_t group_count = rows.group_count();
  out->assign(group_count, '\0');
  for (std::size_t group = 0; group < group_count; ++group) {
    const T* const values = differences.data() + group * kGroupSamples;
    T all = 0;
    for (std::size_t i = 0; i < kGroupSamples; ++i) {
      all = static_cast<T>(all | values[i]);
    }
    const auto bits = static_cast<std::size_t>(std::bit_width(all));
    const std::size_t begin = out->size();
    if (begin + bits * kWordBytes >= samples.size()) {
      return false;
    }
    (*out)[group] = static_cast<char>(bits);
    out->resize(begin + bits * kWordBytes);
    PackGroup(values, bits, out->data() + begin);
  }
  return out->size() < samples.size();
}

// The samples of word `kSlot` of a group of `kBits` bits.
template <typename T, std::size_t kBits, std::size_t kSlot>
std::uint64_t WordOfSlot(const char* packed) {
  using L = Lanes<T>;
  constexpr std::size_t kAt = kSlot * kBits / L::kBits;
  constexpr std::size_t kShift = kSlot * kBits % L::kBits;
  constexpr std::size_t kLow = L::kBits - kShift;
  const std::uint64_t word = LoadWord(packed + kAt * kWordBytes) >> kShift;
  if constexpr (kBits <= kLow) {
    return word & L::Mask(kBits);
  } else {
    const std::uint64_t next = LoadWord(packed + (kAt + 1) * kWordBytes) << kLow;
    return (word & L::Mask(kLow)) | (next & (L::Mask(kBits) & ~L::Mask(kLow)));
  }
}

template <typename T, std::size_t kBits, std::size_t... kSlots>
void UnpackSlots(const char* packed, char* out, std::index_sequence<kSlots...>) {
  (StoreWord(Lanes<T>::UndoZigzag(WordOfSlot<T, kBits, kSlots>(packed)), out + kSlots * kWordBytes),
   ...);
}

// Reads kBits words and writes kGroupSamples samples.
template <typename T, std::size_t kBits>
void UnpackGroup(const char* packed, char* out) {
  if constexpr (kBits == 0) {
    std::memset(out, 0, kGroupSamples * sizeof(T));
  } else {
    UnpackSlots<T, kBits>(packed, out, std::make_index_sequence<Lanes<T>::kBits>());
  }
}

using GroupUnpacker = void (*)(const char*, char*);
template <typename T, std::size_t... kBits>
constexpr std::array<GroupUnpacker, sizeof...(kBits)> UnpackersOf(std::index_sequence<kBits...>) {
  return {&UnpackGroup<T, kBits>...};
}
template <typename T>
constexpr auto kUnpackers = UnpackersOf<T>(std::make_index_sequence<Lanes<T>::kBits + 1>());

template <typename T>
bool HasLengthOfItsWidths(absl::string_view packed, std::size_t group_count) {
  if (packed.size() < group_count) {
    return false;
  }
  std::size_t words = 0;
  for (const char bits : packed.substr(0, group_count)) {
    if (static_cast<unsigned char>(bits) > Lanes<T>::kBits) {
      return false;
    }
    words += static_cast<unsigned char>(bits);
  }
  return packed.size() == group_count + words * kWordBytes;
}

template <typename T>
using Vector __attribute__((vector_size(kVectorBytes))) = T;
template <typename T>
Vector<T> LoadVector(const char* bytes) {
  Vector<T> vector;
  std::memcpy(&vector, bytes, kVectorBytes);
  return vector;
}

// Adds up differences: out[i] = before[i] + (sums[i] += differences[i]). size: bytes, whole vectors
template <typename T>
void AddRow(std::size_t size, const char* differences, const char* before, char* sums, char* out) {
  for (std::size_t at = 0; at < size; at += kVectorBytes) {
    const Vector<T> sum = LoadVector<T>(sums + at) + LoadVector<T>(differences + at);
    std::memcpy(sums + at, &sum, kVectorBytes);
    const Vector<T> sample = sum + LoadVector<T>(before + at);
    std::memcpy(out + at, &sample, kVectorBytes);
  }
}

// Rows are added in whole vectors, so that each writes beyond its end, where the next row will be.
// Rows at the end of `out` take a detour through `last`.
template <typename T>
void AddDifferences(const Rows& rows, const char* differences, char* rows_of_scratch, char* out) {
  const std::size_t row_bytes = rows.x * sizeof(T);
  const std::size_t plane_bytes = rows.plane() * sizeof(T);
  const std::size_t padded = (row_bytes + kVectorBytes - 1) / kVectorBytes * kVectorBytes;
  char* const sums = rows_of_scratch;
  char* const before = sums + padded;
  char* const last = before + padded;
  const std::size_t end = plane_bytes * rows.z;
  std::memset(before, 0, padded);
  for (std::size_t z = 0, at = 0; z < rows.z; ++z) {
    std::memset(sums, 0, padded);
    for (std::size_t y = 0; y < rows.y; ++y, at += row_bytes) {
      if (at + padded <= end) {
        AddRow<T>(padded, differences + at, z == 0 ? before : out + at - plane_bytes, sums,
                  out + at);
        continue;
      }
      if (z > 0) {
        std::memcpy(before, out + at - plane_bytes, row_bytes);
      }
      AddRow<T>(padded, differences + at, before, sums, last);
      std::memcpy(out + at, last, row_bytes);
    }
  }
}

template <typename T>
bool Unpack(const Rows& rows, absl::string_view packed, std::string* scratch, char* out) {
  const std::size_t group_count = rows.group_count();
  if (!HasLengthOfItsWidths<T>(packed, group_count)) {
    return false;
  }
  // Differences of all groups, room for a vector beyond, and three rows of whole vectors.
  const std::size_t group_bytes = kGroupSamples * sizeof(T);
  const std::size_t difference_bytes = group_count * group_bytes + kVectorBytes;
  scratch->resize(difference_bytes + 3 * (rows.x * sizeof(T) + kVectorBytes));
  const char* words = packed.data() + group_count;
  for (std::size_t group = 0; group < group_count; ++group) {
    const auto bits = static_cast<unsigned char>(packed[group]);
    kUnpackers<T>[bits](words, scratch->data() + group * group_bytes);
    words += bits * kWordBytes;
  }
  AddDifferences<T>(rows, scratch->data(), scratch->data() + difference_bytes, out);
  return true;
}

Rows RowsOf(const math::Index3& dims) {
  return {static_cast<std::size_t>(dims.x), static_cast<std::size_t>(dims.y),
          static_cast<std::size_t>(dims.z)};
}

}  // namespace

bool PackSamples(std::size_t width, const math::Index3& dims, absl::string_view samples,
                 std::string* out) {
  const Rows rows = RowsOf(dims);
  ISOSCOPE_CHECK_EQ(samples.size(), rows.count() * width);
  switch (width) {
    case 1:
      return Pack<std::uint8_t>(rows, samples, out);
    case 2:
      return Pack<std::uint16_t>(rows, samples, out);
    default:
      ISOSCOPE_CHECK_EQ(width, 4U);
      return Pack<std::uint32_t>(rows, samples, out);
  }
}

bool UnpackSamples(std::size_t width, const math::Index3& dims, absl::string_view packed,
                   std::string* scratch, char* out) {
  const Rows rows = RowsOf(dims);
  switch (width) {
    case 1:
      return Unpack<std::uint8_t>(rows, packed, scratch, out);
    case 2:
      return Unpack<std::uint16_t>(rows, packed, scratch, out);
    default:
      ISOSCOPE_CHECK_EQ(width, 4U);
      return Unpack<std::uint32_t>(rows, packed, scratch, out);
  }
}

}  // namespace isoscope::store
