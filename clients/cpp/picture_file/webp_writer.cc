#include "clients/cpp/picture_file/webp_writer.h"

#include <cmath>
#include <cstdint>
#include <utility>

#include "absl/strings/str_cat.h"
#include <webp/encode.h>
#include <webp/mux.h>

#include "core/base/status_macros.h"
#include "core/image/png_codec.h"
#include "core/io/atomic_file.h"

namespace isoscope::client {
namespace {

// Effort, from 0 (fast) to 9 (small).
constexpr int kLosslessLevel = 2;
constexpr double kMsPerSecond = 1000;
constexpr double kMaxDurationMs = 2e9;  // libwebp counts in int

struct EncoderDeleter {
  void operator()(WebPAnimEncoder* encoder) const { WebPAnimEncoderDelete(encoder); }
};

// Frees what libwebp has allocated in them.
struct Picture : WebPPicture {
  Picture() { is_valid = WebPPictureInit(this) != 0; }
  ~Picture() { WebPPictureFree(this); }
  Picture(const Picture&) = delete;
  Picture& operator=(const Picture&) = delete;

  bool is_valid = false;
};

struct Data : WebPData {
  Data() { WebPDataInit(this); }
  ~Data() { WebPDataClear(this); }
  Data(const Data&) = delete;
  Data& operator=(const Data&) = delete;
};

// The options of every picture.
absl::StatusOr<WebPConfig> MakeConfig() {
  WebPConfig config;
  if (WebPConfigInit(&config) == 0 || WebPConfigLosslessPreset(&config, kLosslessLevel) == 0) {
    return absl::InternalError("libwebp has another version than this program was built for");
  }
  config.exact = 1;  // colours of transparent pixels, too
  return config;
}

absl::Status Import(const image::RgbaImage& from, Picture* picture) {
  picture->use_argb = 1;
  picture->width = from.width;
  picture->height = from.height;
  if (!picture->is_valid ||
      WebPPictureImportRGBA(picture, reinterpret_cast<const std::uint8_t*>(from.pixels.data()),
                            from.width * static_cast<int>(sizeof(image::Rgba8))) == 0) {
    return absl::ResourceExhaustedError(
        absl::StrCat("libwebp has no memory for ", from.width, " x ", from.height, " pixels"));
  }
  return absl::OkStatus();
}

// Takes the bytes that libwebp writes, and frees them.
struct Memory : WebPMemoryWriter {
  Memory() { WebPMemoryWriterInit(this); }
  ~Memory() { WebPMemoryWriterClear(this); }
  Memory(const Memory&) = delete;
  Memory& operator=(const Memory&) = delete;
};

class WebpWriter : public AnimationWriter {
 public:
  WebpWriter(std::string path, const AnimationOptions& options)
      : path_(std::move(path)), options_(options) {}

  absl::Status Open() {
    const double duration_ms = options_.frame_count * kMsPerSecond / options_.fps;
    if (duration_ms > kMaxDurationMs) {
      return absl::InvalidArgumentError(
          absl::StrCat("'", path_, "': ", options_.frame_count, " frames at ", options_.fps,
                       " a second last longer than a WebP can: write fewer, or more a second"));
    }
    WebPAnimEncoderOptions encoder_options;
    if (WebPAnimEncoderOptionsInit(&encoder_options) == 0) {
      return absl::InternalError("libwebp has another version than this program was built for");
    }
    ISOSCOPE_ASSIGN_OR_RETURN(config_, MakeConfig());
    encoder_.reset(WebPAnimEncoderNew(options_.width_px, options_.height_px, &encoder_options));
    if (encoder_ == nullptr) {
      return absl::ResourceExhaustedError(absl::StrCat("libwebp has no memory for an animation of ",
                                                       options_.width_px, " x ", options_.height_px,
                                                       " pixels"));
    }
    return absl::OkStatus();
  }

  absl::Status AddFrame(absl::string_view png) override {
    ISOSCOPE_ASSIGN_OR_RETURN(const image::RgbaImage frame, image::DecodePng(png));
    if (frame.width != options_.width_px || frame.height != options_.height_px) {
      return absl::DataLossError(absl::StrCat("frame ", added_count_, " has ", frame.width, " x ",
                                              frame.height, " pixels; expected ", options_.width_px,
                                              " x ", options_.height_px));
    }
    Picture picture;
    ISOSCOPE_RETURN_IF_ERROR(Import(frame, &picture));
    if (WebPAnimEncoderAdd(encoder_.get(), &picture, TimeOf(added_count_), &config_) == 0) {
      return Failed();
    }
    ++added_count_;
    return absl::OkStatus();
  }

  absl::Status Finish() override {
    if (added_count_ != options_.frame_count) {
      return absl::FailedPreconditionError(absl::StrCat("an animation of ", options_.frame_count,
                                                        " frames was given ", added_count_));
    }
    Data data;
    if (WebPAnimEncoderAdd(encoder_.get(), nullptr, TimeOf(added_count_), nullptr) == 0 ||
        WebPAnimEncoderAssemble(encoder_.get(), &data) == 0) {
      return Failed();
    }
    return io::WriteFileAtomically(
        path_, absl::string_view(reinterpret_cast<const char*>(data.bytes), data.size));
  }

 private:
  // Returns the start of frame i in milliseconds.
  [[nodiscard]] int TimeOf(int i) const {
    return static_cast<int>(std::lround(i * kMsPerSecond / options_.fps));
  }

  [[nodiscard]] absl::Status Failed() const {
    return absl::InternalError(absl::StrCat("libwebp can't encode frame ", added_count_, ": ",
                                            WebPAnimEncoderGetError(encoder_.get())));
  }

  const std::string path_;
  const AnimationOptions options_;
  WebPConfig config_{};
  std::unique_ptr<WebPAnimEncoder, EncoderDeleter> encoder_;
  int added_count_ = 0;
};

}  // namespace

absl::StatusOr<std::unique_ptr<AnimationWriter>> CreateWebp(const std::string& path,
                                                            const AnimationOptions& options) {
  auto writer = std::make_unique<WebpWriter>(path, options);
  ISOSCOPE_RETURN_IF_ERROR(writer->Open());
  return writer;
}

absl::StatusOr<std::string> WebpOfPng(absl::string_view png) {
  ISOSCOPE_ASSIGN_OR_RETURN(const image::RgbaImage decoded, image::DecodePng(png));
  if (decoded.width > kMaxWebpSidePx || decoded.height > kMaxWebpSidePx) {
    return absl::InvalidArgumentError(absl::StrCat("the picture has ", decoded.width, " x ",
                                                   decoded.height, " pixels; a WebP has at most ",
                                                   kMaxWebpSidePx, " a side"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const WebPConfig config, MakeConfig());
  Picture picture;
  ISOSCOPE_RETURN_IF_ERROR(Import(decoded, &picture));
  Memory memory;
  picture.writer = WebPMemoryWrite;
  picture.custom_ptr = static_cast<WebPMemoryWriter*>(&memory);
  if (WebPEncode(&config, &picture) == 0) {
    return absl::InternalError(
        absl::StrCat("libwebp can't encode the picture: error ", picture.error_code));
  }
  return std::string(reinterpret_cast<const char*>(memory.mem), memory.size);
}

}  // namespace isoscope::client
