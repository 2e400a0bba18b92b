// isoscope render INPUT | DIR | --server HOST:PORT --isovalue V --output FILE.png

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"

#include "client-cli/camera_flags.h"
#include "client-cli/command.h"
#include "client-cli/flags.h"
#include "client-cli/frame_statistics.h"
#include "client-cli/no_surface.h"
#include "client-cli/output.h"
#include "client-cli/parse_value.h"
#include "client-cli/plane_flags.h"
#include "client-cli/poster.h"
#include "client-cli/render_request.h"
#include "client-cli/session.h"
#include "client-cli/usage.h"
#include "core/base/status_macros.h"
#include "core/image/png_codec.h"
#include "core/rpc/proto_convert.h"

namespace isoscope::cli {
namespace {

namespace v1 = isoscope::v1;

// One message is copied less often than parts are, but takes memory for the whole twice.
constexpr std::size_t kMaxUnaryPlaneBytes = std::size_t{64} << 20;
constexpr std::int64_t kMaxRepeatCount = 1'000'000;

struct RenderFlags {
  SessionFlags session;
  RequestFlags request;
  PlaneFlags planes;
  std::optional<std::string> output;
  std::optional<std::string> stats;
  std::optional<std::int64_t> repeat_count;
  std::optional<double> orbit_degrees;
};

// Whether the picture is drawn region by region.
bool IsPoster(const RenderFlags& flags) {
  return !flags.request.region && NeedsRegions(flags.request.viewport());
}

absl::Status CheckUsage(const RenderFlags& flags) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.session));
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.request));
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.planes, flags.output));
  if (!flags.output && !flags.planes.any_plane()) {
    return UsageError("--output FILE.png is missing: the picture to write");
  }
  const bool is_jpeg = flags.output && IsJpegName(FrameFileName(*flags.output, 0));
  if (flags.output && !is_jpeg) {
    ISOSCOPE_RETURN_IF_ERROR(CheckSuffix(FrameFileName(*flags.output, 0), ".png", "PNG"));
  }
  if (IsPoster(flags) && (is_jpeg || flags.planes.any_plane())) {
    return UsageError(absl::StrCat(
        "a picture of ", flags.request.viewport().width_px, " x ",
        flags.request.viewport().height_px, " pixels is drawn in regions into a PNG: ",
        is_jpeg ? "--output must end in .png" : "planes are written of a --region of it"));
  }
  if (IsPoster(flags) && flags.repeat_count.value_or(1) > 1) {
    return UsageError(absl::StrCat(
        "--repeat makes several pictures, but one of ", flags.request.viewport().width_px, " x ",
        flags.request.viewport().height_px,
        " pixels is drawn in regions, one at a time: leave --repeat out, or ask for at most ",
        kMaxSinglePixels, " pixels"));
  }
  if (flags.orbit_degrees && flags.repeat_count.value_or(1) == 1) {
    return UsageError("--orbit turns the camera between frames: it needs --repeat N with N > 1");
  }
  return absl::OkStatus();
}

// Finds out before any work whether its result can be kept.
absl::Status CheckOutputs(const RenderFlags& flags) {
  if (flags.output) {
    ISOSCOPE_RETURN_IF_ERROR(CheckWritable(FrameFileName(*flags.output, 0)));
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckWritable(flags.planes));
  return flags.stats && *flags.stats != "-" ? CheckWritable(*flags.stats) : absl::OkStatus();
}

absl::Status WriteStatistics(const RenderFlags& flags, const std::vector<FrameRecord>& frames,
                             const Context& context) {
  if (!flags.stats) {
    return absl::OkStatus();
  }
  const std::string json = StatisticsToJson(frames).dump(2) + "\n";
  if (*flags.stats == "-") {
    *context.out << json;
    return absl::OkStatus();
  }
  return WriteFileAtomically(*flags.stats, json);
}

absl::StatusOr<image::RgbaImage> ImageOfRaw(const v1::RenderIsosurfaceResponse& response) {
  image::RgbaImage image{
      .width = response.extent().width_px(), .height = response.extent().height_px(), .pixels = {}};
  const std::size_t pixels =
      static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height);
  if (pixels == 0 || response.rgba8().size() != pixels * sizeof(image::Rgba8)) {
    return absl::DataLossError(absl::StrCat(
        "the server sent ", response.rgba8().size(), " bytes for a picture of ", image.width, " x ",
        image.height, " pixels: it may be older than this program, and not know raw pictures"));
  }
  image.pixels.resize(pixels);
  std::memcpy(image.pixels.data(), response.rgba8().data(), response.rgba8().size());
  return image;
}

// Asks for a frame: in parts if its planes are large.
absl::StatusOr<v1::RenderIsosurfaceResponse> RenderOne(const RenderFlags& flags,
                                                       const v1::RenderIsosurfaceRequest& request,
                                                       Session* session) {
  const view::Viewport size = flags.request.image_size();
  const std::size_t plane_bytes = static_cast<std::size_t>(size.width_px) *
                                  static_cast<std::size_t>(size.height_px) *
                                  flags.planes.bytes_per_pixel();
  return plane_bytes > kMaxUnaryPlaneBytes
             ? session->client().RenderIsosurfaceStream(request, session->timeout())
             : session->client().RenderIsosurface(request, session->timeout());
}

// Writes what a response brought: the picture, if it is asked for, and planes.
absl::Status WriteFrame(const RenderFlags& flags, int frame_index,
                        const v1::RenderIsosurfaceResponse& response) {
  if (flags.output) {
    const std::string path = FrameFileName(*flags.output, frame_index);
    ISOSCOPE_RETURN_IF_ERROR(
        WriteFileAtomically(path, IsJpegName(path) ? response.jpeg() : response.png()));
  }
  return WritePlanes(flags.planes, response);
}

// Renders a picture that is too large for one frame, region by region.
absl::Status RunPoster(const RenderFlags& flags, const v1::RenderIsosurfaceRequest& whole,
                       Session* session, const Context& context) {
  const absl::Time start = absl::Now();
  const view::Viewport viewport = flags.request.viewport();
  std::vector<FrameRecord> regions;
  const auto render = [&](const view::Region& region) -> absl::StatusOr<image::RgbaImage> {
    v1::RenderIsosurfaceRequest request = whole;
    *request.mutable_region() = rpc::ToProto(region);
    request.mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_RGBA8);
    const absl::Time region_start = absl::Now();
    ISOSCOPE_ASSIGN_OR_RETURN(v1::RenderIsosurfaceResponse response,
                              session->client().RenderIsosurface(request, session->timeout()));
    regions.push_back({.wall_ms = absl::ToDoubleMilliseconds(absl::Now() - region_start),
                       .statistics = std::move(*response.mutable_statistics())});
    return ImageOfRaw(response);
  };
  const std::string path = FrameFileName(*flags.output, 0);
  const bool is_opaque = !whole.has_background_color() || whole.background_color().alpha() == 1.0F;
  std::int64_t size_bytes = 0;
  {
    ProgressLine line(context.err, context.err_is_terminal);
    ISOSCOPE_ASSIGN_OR_RETURN(size_bytes,
                              WritePoster(viewport, is_opaque, path, render,
                                          [&](absl::string_view text) { line.Update(text); }));
  }
  ISOSCOPE_RETURN_IF_ERROR(WriteStatistics(flags, regions, context));
  std::ostream& text = flags.stats == "-" ? *context.err : *context.out;
  text << path << ": " << viewport.width_px << " x " << viewport.height_px << " pixels in "
       << FormatCount(static_cast<std::int64_t>(regions.size())) << " regions, "
       << FormatMebibytes(size_bytes) << ", in " << FormatElapsed(absl::Now() - start) << "\n";
  return absl::OkStatus();
}

absl::Status Run(const RenderFlags& flags, const Context& context) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags));
  ISOSCOPE_RETURN_IF_ERROR(CheckOutputs(flags));
  const bool is_poster = IsPoster(flags);
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::unique_ptr<Session> session,
      Session::Open(flags.session,
                    is_poster ? RegionSizeOf(flags.request.viewport()) : flags.request.image_size(),
                    context));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const v1::Dataset dataset,
      session->client().GetDataset(session->dataset_name(), session->timeout()));
  ISOSCOPE_ASSIGN_OR_RETURN(const volume::GridGeometry geometry,
                            rpc::GeometryFromProto(dataset.geometry(), "dataset.geometry"));
  WarnIfNoSurface(dataset, flags.request.isovalue.value_or(0), context);
  ISOSCOPE_ASSIGN_OR_RETURN(const view::Camera camera,
                            ResolveCamera(flags.request.camera, geometry.Bounds()));

  if (is_poster) {
    return RunPoster(flags, MakeRequest(flags.request, dataset.name(), camera), session.get(),
                     context);
  }
  const auto frame_count = static_cast<int>(flags.repeat_count.value_or(1));
  const std::string output = flags.output.value_or("");
  const bool has_file_for_each_frame = FrameFileName(output, 0) != FrameFileName(output, 1);
  std::vector<FrameRecord> frames;
  for (int i = 0; i < frame_count; ++i) {
    v1::RenderIsosurfaceRequest request = MakeRequest(
        flags.request, dataset.name(), OrbitCamera(camera, flags.orbit_degrees.value_or(0), i));
    if (!flags.output || IsJpegName(output) || flags.planes.any_plane()) {
      *request.mutable_output() = MakeOutputOptions(flags.planes, flags.output);
    }
    const absl::Time start = absl::Now();
    ISOSCOPE_ASSIGN_OR_RETURN(v1::RenderIsosurfaceResponse response,
                              RenderOne(flags, request, session.get()));
    frames.push_back({.wall_ms = absl::ToDoubleMilliseconds(absl::Now() - start),
                      .statistics = std::move(*response.mutable_statistics())});
    if (has_file_for_each_frame || i + 1 == frame_count) {
      ISOSCOPE_RETURN_IF_ERROR(WriteFrame(flags, i, response));
    }
  }
  ISOSCOPE_RETURN_IF_ERROR(WriteStatistics(flags, frames, context));
  std::ostream& text = flags.stats == "-" ? *context.err : *context.out;
  text << DescribeStatistics(frames) << "\n"
       << (flags.output ? FrameFileName(output, frame_count - 1) : "planes") << ": "
       << flags.request.image_size().width_px << " x " << flags.request.image_size().height_px
       << " pixels\n";
  return absl::OkStatus();
}

Action RegisterFlags(CLI::App* app) {
  const auto flags = std::make_shared<RenderFlags>();
  AddSessionFlags(app, &flags->session);
  AddRendererFlag(app, &flags->session);
  AddFlag(
      app, "--output", "FILE.png", &flags->output, ParseText,
      "the picture, a PNG, or a JPEG if it ends in .jpg; with %d or {} in its name one for each "
      "frame, numbered from 0");
  AddRequestFlags(app, &flags->request);
  AddPlaneFlags(app, &flags->planes);
  AddFlag(
      app, "--repeat", "N", &flags->repeat_count,
      [](absl::string_view text) { return ParseInteger(text, 1, kMaxRepeatCount); },
      "frames to render, one request each (default: 1)");
  AddFlag(app, "--orbit", "DEG", &flags->orbit_degrees, ParseNumber,
          "turn the camera about up after each frame (default: 0)");
  AddFlag(app, "--stats", "FILE|-", &flags->stats, ParseText,
          "write statistics as JSON (- is standard output)");
  return [flags](const Context& context) { return Run(*flags, context); };
}

}  // namespace

Command RenderCommand() {
  return {
      .name = "render",
      .summary = "Renders an isosurface of a volume, a dataset or a server's dataset to a picture",
      .usage = "INPUT | DIR | --server HOST:PORT --isovalue V --output FILE.png [OPTIONS]",
      .examples =
          "  isoscope render head.nii.gz --isovalue 60 --azimuth 30 --output head.png\n"
          "  isoscope render --server localhost:50051 --isovalue 60 --repeat 36 --orbit 10 \\\n"
          "    --output turn-%d.png --stats turn.json\n"
          "  isoscope render head.nii.gz --isovalue 60 --width 32768 --height 32768 \\\n"
          "    --renderer cpu --output poster.png\n"
          "  isoscope render head.nii.gz --isovalue 60 --output head.jpg --depth depth.npy\n",
      .register_flags = RegisterFlags};
}

}  // namespace isoscope::cli
