// The file, with sequence numbers that count fcTL and fdAT together:
//
//   signature, IHDR, sRGB        of the first frame
//   acTL  frames, plays (0: for ever)
//   fcTL 0, IDAT ...             first frame, also what other programs show
//   fcTL 1, fdAT 2, fdAT 3 ...   second frame: a sequence number before the bytes of each IDAT
//   ...
//   IEND
//
// All frames share one IHDR, so they have one colour type: RGB, or RGBA if the background is
// visible. EncodePng writes RGB for an opaque frame; in an RGBA animation it is encoded again.

#include "clients/cpp/picture_file/apng_writer.h"

#include <png.h>

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"

#include "clients/cpp/picture_file/png_chunks.h"
#include "core/base/status_macros.h"
#include "core/image/png_codec.h"
#include "core/io/atomic_file.h"

namespace isoscope::client {
namespace {

constexpr std::size_t kIhdrBytes = 13;
constexpr std::size_t kColorTypeOffset = 9;
constexpr char kRgb = 2;
constexpr char kRgba = 6;
// A delay is a fraction of two 16-bit numbers: this many hundredths of a frame.
constexpr int kDelayNumerator = 100;

std::string BigEndian16(int value) {
  return {static_cast<char>(value >> 8), static_cast<char>(value)};
}

// Returns the picture as RGBA, whatever its colour type.
absl::StatusOr<std::string> EncodeRgba(absl::string_view png) {
  ISOSCOPE_ASSIGN_OR_RETURN(const image::RgbaImage picture, image::DecodePng(png));
  png_image header{};
  header.version = PNG_IMAGE_VERSION;
  header.width = static_cast<png_uint_32>(picture.width);
  header.height = static_cast<png_uint_32>(picture.height);
  header.format = PNG_FORMAT_RGBA;
  header.flags = PNG_IMAGE_FLAG_FAST;
  png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(header);
  std::string bytes(size, '\0');
  if (png_image_write_to_memory(&header, bytes.data(), &size, 0, picture.pixels.data(), 0,
                                nullptr) == 0) {
    return absl::InternalError(absl::StrCat("a frame can't be encoded: ", header.message));
  }
  bytes.resize(size);
  return bytes;
}

class ApngWriter : public AnimationWriter {
 public:
  ApngWriter(std::unique_ptr<io::AtomicFile> file, const AnimationOptions& options)
      : options_(options), file_(std::move(file)) {}

  absl::Status AddFrame(absl::string_view png) override {
    ISOSCOPE_ASSIGN_OR_RETURN(std::vector<PngChunk> chunks, ParsePngChunks(png));
    std::string as_rgba;
    if (options_.has_alpha && ColorTypeOf(chunks) == kRgb) {
      ISOSCOPE_ASSIGN_OR_RETURN(as_rgba, EncodeRgba(png));
      ISOSCOPE_ASSIGN_OR_RETURN(chunks, ParsePngChunks(as_rgba));
    }
    ISOSCOPE_RETURN_IF_ERROR(CheckHeader(chunks[0].data));
    std::string out;
    if (added_count_ == 0) {
      out = Head(chunks);
    }
    absl::StrAppend(&out, FrameControl());
    for (const PngChunk& chunk : chunks) {
      if (chunk.type != "IDAT") {
        continue;
      }
      absl::StrAppend(
          &out, added_count_ == 0
                    ? std::string(chunk.bytes)
                    : MakePngChunk("fdAT", absl::StrCat(BigEndian32(sequence_++), chunk.data)));
    }
    ++added_count_;
    return file_->Append(out);
  }

  absl::Status Finish() override {
    if (added_count_ != options_.frame_count) {
      return absl::FailedPreconditionError(absl::StrCat("an animation of ", options_.frame_count,
                                                        " frames was given ", added_count_));
    }
    ISOSCOPE_RETURN_IF_ERROR(file_->Append(MakePngChunk("IEND", "")));
    return file_->Commit();
  }

 private:
  static char ColorTypeOf(const std::vector<PngChunk>& chunks) {
    return chunks[0].data.size() == kIhdrBytes ? chunks[0].data[kColorTypeOffset] : '\0';
  }

  // The IHDR must be the same for all frames: 8 bits, not interlaced.
  [[nodiscard]] absl::Status CheckHeader(absl::string_view ihdr) const {
    const std::array<char, 5> format{8, options_.has_alpha ? kRgba : kRgb, 0, 0, 0};
    const std::string expected =
        absl::StrCat(BigEndian32(static_cast<std::uint32_t>(options_.width_px)),
                     BigEndian32(static_cast<std::uint32_t>(options_.height_px)),
                     absl::string_view(format.data(), format.size()));
    if (ihdr != expected) {
      return absl::DataLossError(absl::StrCat(
          "frame ", added_count_, " is not a picture of ", options_.width_px, " x ",
          options_.height_px, " pixels of ", options_.has_alpha ? "RGBA" : "RGB", ", 8 bits each"));
    }
    return absl::OkStatus();
  }

  // Returns the bytes before the pixels of the first frame, without text chunks.
  [[nodiscard]] std::string Head(const std::vector<PngChunk>& chunks) const {
    std::string head(kPngSignature);
    for (const PngChunk& chunk : chunks) {
      if (chunk.type == "IHDR" || chunk.type == "sRGB") {
        absl::StrAppend(&head, chunk.bytes);
      }
    }
    return absl::StrCat(
        head,
        MakePngChunk("acTL",
                     absl::StrCat(BigEndian32(static_cast<std::uint32_t>(options_.frame_count)),
                                  BigEndian32(0))));
  }

  // fcTL: the whole picture at (0, 0), written over the frame before.
  std::string FrameControl() {
    const int denominator = static_cast<int>(std::lround(options_.fps * kDelayNumerator));
    const std::array<char, 2> no_dispose_no_blend{0, 0};
    return MakePngChunk(
        "fcTL",
        absl::StrCat(BigEndian32(sequence_++),
                     BigEndian32(static_cast<std::uint32_t>(options_.width_px)),
                     BigEndian32(static_cast<std::uint32_t>(options_.height_px)), BigEndian32(0),
                     BigEndian32(0), BigEndian16(kDelayNumerator), BigEndian16(denominator),
                     absl::string_view(no_dispose_no_blend.data(), 2)));
  }

  const AnimationOptions options_;
  const std::unique_ptr<io::AtomicFile> file_;  // removed without Finish
  int added_count_ = 0;
  std::uint32_t sequence_ = 0;
};

}  // namespace

absl::StatusOr<std::unique_ptr<AnimationWriter>> CreateApng(const std::string& path,
                                                            const AnimationOptions& options) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<io::AtomicFile> file, io::AtomicFile::Create(path));
  return std::make_unique<ApngWriter>(std::move(file), options);
}

}  // namespace isoscope::client
