// EncodePng and PngRowWriter work on stripes of rows, in parallel:
//
//   1. IsOpaque: RGB if no pixel shows through, else RGBA.
//   2. FilterUp each row against the row above (PNG, filter type 2). The first row of a stripe
//      takes the last pixels of the stripe before, not its result, so stripes do not wait for each
//      other.
//   3. Deflate the stripe to blocks that refer to nothing before the stripe, and flush to a whole
//      byte.
//   4. Join: each stripe is an IDAT chunk, and together they are one zlib stream:
//
//        signature, IHDR, sRGB
//        IDAT   78 01, blocks of stripe 0
//        IDAT   blocks of stripe 1
//        ...
//        IDAT   03 00, Adler-32
//        IEND
//
//      78 01 is the zlib header (RFC 1950), 03 00 an empty final block (RFC 1951). The Adler-32 of
//      the whole is combined from those of the stripes.
//
// Example: a row of 1024 RGBA pixels has 1 + 4096 bytes, filter type first, so a stripe of 256 KiB
// has 63 rows, and 1024 rows make 17 stripes.
//
// Invariant: stripes depend on the image alone, so the bytes do not depend on the number of
// threads.
//
// Sources: PNG specification (ISO/IEC 15948), sections 5, 9 and 10; RFC 1950; RFC 1951.

#include <zlib.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>

#include "absl/strings/str_cat.h"
#include "oneapi/tbb/enumerable_thread_specific.h"
#include "oneapi/tbb/parallel_for.h"
#include "oneapi/tbb/partitioner.h"
#include "oneapi/tbb/task_arena.h"
#include "oneapi/tbb/task_group.h"
#include <isa-l/crc.h>
#include <isa-l/igzip_lib.h>

#include "core/base/check.h"
#include "core/image/png_codec.h"
#include "core/image/png_filter.h"

namespace isoscope::image {
namespace {

// A stripe has about this many bytes, whatever the number of threads: 17 stripes for a frame of
// 1024 x 1024, each so large that its own Huffman codes cost little (64 KiB take 17 % more time,
// 512 KiB no less).
constexpr std::size_t kStripeBytes = std::size_t{256} * 1024;
constexpr std::size_t kMaxRowBytes = std::size_t{1} << 30;  // ISA-L counts in 32 bits

constexpr absl::string_view kSignature("\x89PNG\r\n\x1a\n", 8);
constexpr std::size_t kLengthBytes = 4;
constexpr std::size_t kTypeBytes = 4;
constexpr std::size_t kCrcBytes = 4;
constexpr absl::string_view kDeflateWindow32K("\x78\x01", 2);  // RFC 1950
constexpr absl::string_view kDeflateEnd("\x03\x00", 2);        // RFC 1951: an empty last block
constexpr absl::string_view kPerceptualIntent("\x00", 1);
constexpr std::uint8_t kFilterTypeUp = 2;

std::string BigEndian32(std::uint32_t value) {
  return {static_cast<char>(value >> 24), static_cast<char>(value >> 16),
          static_cast<char>(value >> 8), static_cast<char>(value)};
}

// Appends a chunk whose data are `head`, then `body`.
void AppendChunk(absl::string_view type, absl::string_view head, absl::string_view body,
                 std::string* out) {
  const std::size_t size = head.size() + body.size();
  const std::size_t begin = out->size();
  out->reserve(begin + kLengthBytes + kTypeBytes + size + kCrcBytes);
  absl::StrAppend(out, BigEndian32(static_cast<std::uint32_t>(size)), type, head, body);
  const auto* covered = reinterpret_cast<const unsigned char*>(out->data() + begin + kLengthBytes);
  absl::StrAppend(out, BigEndian32(crc32_gzip_refl(0, covered, kTypeBytes + size)));
}

// The buffers and deflate state with which a thread encodes stripes, one after another.
class StripeEncoder {
 public:
  // Returns room for `size` bytes to deflate, and kFilterSlackBytes more.
  std::uint8_t* Filtered(std::size_t size) {
    filtered_.Reserve(size + kFilterSlackBytes, 0);
    return filtered_.bytes.get();
  }

  // Step 3: deflates the first `size` bytes of Filtered. The blocks refer to nothing before them
  // and end at a whole byte. The result is valid until the next call. REQUIRES: size > kHeadBytes.
  absl::string_view Deflate(std::size_t size) {
    isal_deflate_init(stream_.get());
    stream_->level = kLevel;
    stream_->level_buf = level_buffer_.get();
    stream_->level_buf_size = kLevelBufferBytes;
    stream_->next_in = filtered_.bytes.get();
    deflated_.Reserve(size + kSpareBytes, 0);
    std::size_t used = 0;
    DeflateNext(kHeadBytes, SYNC_FLUSH, &used);
    DeflateNext(size - kHeadBytes, FULL_FLUSH, &used);
    return {reinterpret_cast<const char*>(deflated_.bytes.get()), used};
  }

 private:
  // Deflates the next `size` bytes to deflated_ behind its first `*used` bytes, and updates
  // `*used`.
  void DeflateNext(std::size_t size, std::uint16_t flush, std::size_t* used) {
    stream_->flush = flush;
    stream_->avail_in = static_cast<std::uint32_t>(size);
    while (true) {
      stream_->next_out = deflated_.bytes.get() + *used;
      stream_->avail_out = static_cast<std::uint32_t>(deflated_.capacity - *used);
      ISOSCOPE_CHECK_EQ(isal_deflate(stream_.get()), COMP_OK);
      *used = deflated_.capacity - stream_->avail_out;
      if (stream_->avail_out > 0) {
        break;
      }
      deflated_.Reserve(*used + *used / 8 + kSpareBytes, *used);  // noise gets larger
    }
    ISOSCOPE_CHECK_EQ(stream_->avail_in, 0U);
  }

  // Measured on a 1024 x 1024 CT head and random field, RGBA, filter "up" (CPU milliseconds of
  // deflating alone, kilobytes): zlib level 1: 8.4, 221 and 17.3, 486; ISA-L level 0: 1.2, 261 and
  // 3.2, 517; level 1: 1.3, 221 and 3.4, 440; level 2: 1.4, 216 and 3.5, 440; level 3: 5.1, 223 and
  // 7.0, 460. At level 1 the filter "none" gives 207 and 596, "sub" 230 and 459, "Paeth" 229 and
  // 458.
  static constexpr std::uint32_t kLevel = 1;
  static constexpr std::size_t kLevelBufferBytes = ISAL_DEF_LVL1_DEFAULT;
  static constexpr std::size_t kSpareBytes = 64;
  // This many bytes are deflated first, as literals. Without them ISA-L 2.30 (igzip_icf_body,
  // .write_first_byte) hashes the address of its stream instead of the third byte: one coordinator
  // in 2000 had other bytes for the same picture. Fewer than 4 do not avoid that; 4 cost 10 bytes a
  // stripe.
  static constexpr std::size_t kHeadBytes = 4;

  struct Buffer {
    // Grows the buffer, and keeps its first `used` bytes.
    void Reserve(std::size_t min_capacity, std::size_t used) {
      if (min_capacity > capacity) {
        auto larger = std::make_unique_for_overwrite<std::uint8_t[]>(min_capacity);
        std::copy_n(bytes.get(), used, larger.get());
        bytes = std::move(larger);
        capacity = min_capacity;
      }
    }

    std::unique_ptr<std::uint8_t[]> bytes;
    std::size_t capacity = 0;
  };

  std::unique_ptr<isal_zstream> stream_ = std::make_unique_for_overwrite<isal_zstream>();
  std::unique_ptr<std::uint8_t[]> level_buffer_ =
      std::make_unique_for_overwrite<std::uint8_t[]>(kLevelBufferBytes);
  Buffer filtered_;
  Buffer deflated_;
};

struct Stripe {
  std::string chunk;  // IDAT
  std::uint32_t adler = 0;
  std::size_t filtered_bytes = 0;
};

// Returns true if the alpha of each pixel is 0 or 255.
bool AllOpaqueOrClear(std::span<const Rgba8> pixels) {
  std::uint32_t found = 0;
  for (const Rgba8& pixel : pixels) {
    found |= (pixel.a + 1U) & 0xfe;
  }
  return found == 0;
}

// The rows of a PNG, as they are shown and stored.
struct RowFormat {
  std::size_t width = 0;
  PngChannels channels = PngChannels::kRgba;
  std::optional<Rgba8> background;

  [[nodiscard]] std::size_t stored_row_bytes() const {
    return 1 + width * static_cast<std::size_t>(channels);
  }
};

std::size_t RowsPerStripe(std::size_t width) {
  const std::size_t row_bytes = 1 + width * sizeof(Rgba8);
  ISOSCOPE_CHECK_LE(row_bytes, kMaxRowBytes);
  return std::max<std::size_t>(1, kStripeBytes / row_bytes);
}

// Copies a row, with the background where alpha is 0.
void ShowRow(const RowFormat& format, std::span<const Rgba8> pixels, std::vector<Rgba8>* row) {
  if (!format.background.has_value()) {
    std::copy(pixels.begin(), pixels.end(), row->begin());
    return;
  }
  // Words take one comparison and one choice a pixel, which compilers turn into SIMD.
  const auto background = std::bit_cast<std::uint32_t>(*format.background);
  constexpr auto kAlpha = std::bit_cast<std::uint32_t>(Rgba8{0, 0, 0, 255});
  for (std::size_t x = 0; x < pixels.size(); ++x) {
    const auto word = std::bit_cast<std::uint32_t>(pixels[x]);
    (*row)[x] = std::bit_cast<Rgba8>((word & kAlpha) == 0 ? background : word);
  }
}

// Encodes the rows of a stripe: steps 2 and 3. `row_above` is empty for the first row of the image,
// above which all is transparent black.
Stripe EncodeStripe(const RowFormat& format, std::span<const Rgba8> rows,
                    std::span<const Rgba8> row_above, StripeEncoder* encoder) {
  Stripe stripe;
  stripe.filtered_bytes = rows.size() / format.width * format.stored_row_bytes();
  std::uint8_t* const filtered = encoder->Filtered(stripe.filtered_bytes);
  std::uint8_t* to = filtered;
  std::vector<Rgba8> above(format.width);
  std::vector<Rgba8> row(format.width);
  if (!row_above.empty()) {
    ShowRow(format, row_above, &above);
  }
  for (std::size_t begin = 0; begin < rows.size(); begin += format.width) {
    *to++ = kFilterTypeUp;
    ShowRow(format, rows.subspan(begin, format.width), &row);
    to = FilterUp(row, above, format.channels, to);
    row.swap(above);
  }
  stripe.adler = isal_adler32(1, filtered, stripe.filtered_bytes);
  AppendChunk("IDAT", row_above.empty() ? kDeflateWindow32K : absl::string_view(),
              encoder->Deflate(stripe.filtered_bytes), &stripe.chunk);
  return stripe;
}

// Calls function(stripe) for all stripes, in parallel. Isolated from other work of the arena: the
// waiting thread takes up no other work, and a cancellation of that work does not stop the stripes.
template <typename Function>
void ForEachStripe(std::size_t stripe_count, const Function& function) {
  tbb::task_group_context context(tbb::task_group_context::isolated);
  tbb::this_task_arena::isolate([&] {
    tbb::parallel_for(std::size_t{0}, stripe_count, function, tbb::simple_partitioner(), context);
  });
}

// Encodes whole rows, in parallel. `row_above` as for EncodeStripe.
std::vector<Stripe> EncodeStripes(const RowFormat& format, std::span<const Rgba8> rows,
                                  std::span<const Rgba8> row_above) {
  const std::size_t stripe_size = RowsPerStripe(format.width) * format.width;
  std::vector<Stripe> stripes((rows.size() + stripe_size - 1) / stripe_size);
  tbb::enumerable_thread_specific<StripeEncoder> encoders;
  ForEachStripe(stripes.size(), [&](std::size_t i) {
    const std::size_t begin = i * stripe_size;
    stripes[i] = EncodeStripe(
        format, rows.subspan(begin, std::min(stripe_size, rows.size() - begin)),
        i == 0 ? row_above : rows.subspan(begin - format.width, format.width), &encoders.local());
  });
  return stripes;
}

// Appends the bytes before the stripes.
void AppendHead(const RowFormat& format, std::size_t height, std::string* out) {
  absl::StrAppend(out, kSignature);
  // Bit depth 8; colour type 2 (RGB) or 6 (RGBA); compression and filter method 0, not interlaced.
  const std::array<char, 5> type{8, static_cast<char>(format.channels == PngChannels::kRgb ? 2 : 6),
                                 0, 0, 0};
  AppendChunk("IHDR",
              absl::StrCat(BigEndian32(static_cast<std::uint32_t>(format.width)),
                           BigEndian32(static_cast<std::uint32_t>(height))),
              absl::string_view(type.data(), type.size()), out);
  AppendChunk("sRGB", kPerceptualIntent, "", out);
}

// Appends the bytes after the stripes. `adler` is that of all filtered bytes.
void AppendTail(std::uint32_t adler, std::string* out) {
  AppendChunk("IDAT", kDeflateEnd, BigEndian32(adler), out);
  AppendChunk("IEND", "", "", out);
}

std::uint32_t CombineAdler(std::uint32_t adler, const Stripe& stripe) {
  return static_cast<std::uint32_t>(
      adler32_combine(adler, stripe.adler, static_cast<z_off_t>(stripe.filtered_bytes)));
}

bool IsOpaque(std::size_t width, std::span<const Rgba8> pixels,
              const std::optional<Rgba8>& background) {
  const std::size_t stripe_size = RowsPerStripe(width) * width;
  const bool shows_background = background.has_value() && background->a == 255;
  std::atomic<bool> opaque{true};
  ForEachStripe((pixels.size() + stripe_size - 1) / stripe_size, [&](std::size_t i) {
    const std::size_t begin = i * stripe_size;
    const std::span<const Rgba8> stripe =
        pixels.subspan(begin, std::min(stripe_size, pixels.size() - begin));
    if (opaque.load(std::memory_order_relaxed) &&
        !(shows_background ? AllOpaqueOrClear(stripe) : AllOpaque(stripe))) {
      opaque.store(false, std::memory_order_relaxed);
    }
  });
  return opaque.load();
}

// Step 4: joins the stripes to a file.
std::string Join(const RowFormat& format, std::size_t height, const std::vector<Stripe>& stripes) {
  constexpr std::size_t kOtherChunksBytes = 128;
  std::size_t size = kOtherChunksBytes;
  for (const Stripe& stripe : stripes) {
    size += stripe.chunk.size();
  }
  std::string out;
  out.reserve(size);
  AppendHead(format, height, &out);
  std::uint32_t adler = 1;
  for (const Stripe& stripe : stripes) {
    absl::StrAppend(&out, stripe.chunk);
    adler = CombineAdler(adler, stripe);
  }
  AppendTail(adler, &out);
  return out;
}

}  // namespace

std::string EncodePng(int width, int height, std::span<const Rgba8> pixels,
                      const std::optional<Rgba8>& background) {
  ISOSCOPE_CHECK_GE(width, 1);
  ISOSCOPE_CHECK_GE(height, 1);
  ISOSCOPE_CHECK_EQ(pixels.size(),
                    static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  const auto row_size = static_cast<std::size_t>(width);
  const RowFormat format{
      .width = row_size,
      .channels = IsOpaque(row_size, pixels, background) ? PngChannels::kRgb : PngChannels::kRgba,
      .background = background};
  return Join(format, static_cast<std::size_t>(height), EncodeStripes(format, pixels, {}));
}

int PngRowWriter::RowsPerStripe(int width) {
  return static_cast<int>(image::RowsPerStripe(static_cast<std::size_t>(width)));
}

std::string PngRowWriter::Begin() const {
  std::string head;
  AppendHead({.width = static_cast<std::size_t>(width_), .channels = Channels(), .background = {}},
             static_cast<std::size_t>(height_), &head);
  return head;
}

std::string PngRowWriter::Append(std::span<const Rgba8> rows) {
  const auto row_size = static_cast<std::size_t>(width_);
  ISOSCOPE_CHECK_EQ(rows.size() % row_size, 0U);
  row_count_ += static_cast<int>(rows.size() / row_size);
  ISOSCOPE_CHECK_LE(row_count_, height_);
  std::string bytes;
  if (rows.empty()) {
    return bytes;
  }
  const RowFormat format{.width = row_size, .channels = Channels(), .background = {}};
  for (const Stripe& stripe : EncodeStripes(format, rows, last_row_)) {
    absl::StrAppend(&bytes, stripe.chunk);
    adler_ = CombineAdler(adler_, stripe);
  }
  const std::span<const Rgba8> last = rows.last(row_size);
  last_row_.assign(last.begin(), last.end());
  return bytes;
}

std::string PngRowWriter::End() const {
  ISOSCOPE_CHECK_EQ(row_count_, height_);
  std::string tail;
  AppendTail(adler_, &tail);
  return tail;
}

}  // namespace isoscope::image
