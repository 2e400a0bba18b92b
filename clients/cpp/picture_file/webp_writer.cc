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
    if (WebPAnimEncoderOptionsInit(&encoder_options) == 0 || WebPConfigInit(&config_) == 0 ||
        WebPConfigLosslessPreset(&config_, kLosslessLevel) == 0) {
      return absl::InternalError("libwebp has another version than this program was built for");
    }
    config_.exact = 1;  // colours of transparent pixels, too
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
    picture.use_argb = 1;
    picture.width = frame.width;
    picture.height = frame.height;
    if (!picture.is_valid ||
        WebPPictureImportRGBA(&picture, reinterpret_cast<const std::uint8_t*>(frame.pixels.data()),
                              frame.width * static_cast<int>(sizeof(image::Rgba8))) == 0) {
      return absl::ResourceExhaustedError("libwebp has no memory for a frame");
    }
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

}  // namespace isoscope::client
