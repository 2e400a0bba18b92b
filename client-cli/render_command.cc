// isoscope render INPUT | DIR | --server HOST:PORT --isovalue V --output FILE.png

#include <cstdint>
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
#include "client-cli/render_request.h"
#include "client-cli/session.h"
#include "client-cli/usage.h"
#include "core/base/status_macros.h"
#include "core/rpc/proto_convert.h"

namespace isoscope::cli {
namespace {

constexpr std::int64_t kMaxRepeatCount = 1'000'000;

struct RenderFlags {
  SessionFlags session;
  RequestFlags request;
  std::optional<std::string> output;
  std::optional<std::string> stats;
  std::optional<std::int64_t> repeat_count;
  std::optional<double> orbit_degrees;
};

absl::Status CheckUsage(const RenderFlags& flags) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.session));
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.request));
  if (!flags.output) {
    return UsageError("--output FILE.png is missing: the picture to write");
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckSuffix(FrameFileName(*flags.output, 0), ".png", "PNG"));
  if (flags.orbit_degrees && flags.repeat_count.value_or(1) == 1) {
    return UsageError("--orbit turns the camera between frames: it needs --repeat N with N > 1");
  }
  return absl::OkStatus();
}

// Finds out before any work whether its result can be kept.
absl::Status CheckOutputs(const RenderFlags& flags) {
  ISOSCOPE_RETURN_IF_ERROR(CheckWritable(FrameFileName(*flags.output, 0)));
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

absl::Status Run(const RenderFlags& flags, const Context& context) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags));
  ISOSCOPE_RETURN_IF_ERROR(CheckOutputs(flags));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<Session> session,
                            Session::Open(flags.session, flags.request.viewport(), context));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const isoscope::v1::Dataset dataset,
      session->client().GetDataset(session->dataset_name(), session->timeout()));
  ISOSCOPE_ASSIGN_OR_RETURN(const volume::GridGeometry geometry,
                            rpc::GeometryFromProto(dataset.geometry(), "dataset.geometry"));
  for (const double isovalue : flags.request.isovalues()) {
    WarnIfNoSurface(dataset, isovalue, context);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const view::Camera camera,
                            ResolveCamera(flags.request.camera, geometry.Bounds()));

  const auto frame_count = static_cast<int>(flags.repeat_count.value_or(1));
  const bool has_file_for_each_frame =
      FrameFileName(*flags.output, 0) != FrameFileName(*flags.output, 1);
  std::vector<FrameRecord> frames;
  for (int i = 0; i < frame_count; ++i) {
    const isoscope::v1::RenderIsosurfaceRequest request = MakeRequest(
        flags.request, dataset.name(), OrbitCamera(camera, flags.orbit_degrees.value_or(0), i));
    const absl::Time start = absl::Now();
    ISOSCOPE_ASSIGN_OR_RETURN(isoscope::v1::RenderIsosurfaceResponse response,
                              session->client().RenderIsosurface(request, session->timeout()));
    frames.push_back({.wall_ms = absl::ToDoubleMilliseconds(absl::Now() - start),
                      .statistics = std::move(*response.mutable_statistics())});
    if (has_file_for_each_frame || i + 1 == frame_count) {
      ISOSCOPE_RETURN_IF_ERROR(
          WriteFileAtomically(FrameFileName(*flags.output, i), response.png()));
    }
  }
  ISOSCOPE_RETURN_IF_ERROR(WriteStatistics(flags, frames, context));
  std::ostream& text = flags.stats == "-" ? *context.err : *context.out;
  text << DescribeStatistics(frames) << "\n"
       << FrameFileName(*flags.output, frame_count - 1) << ": " << flags.request.viewport().width_px
       << " x " << flags.request.viewport().height_px << " pixels\n";
  return absl::OkStatus();
}

Action RegisterFlags(CLI::App* app) {
  const auto flags = std::make_shared<RenderFlags>();
  AddSessionFlags(app, &flags->session);
  AddRendererFlag(app, &flags->session);
  AddFlag(app, "--output", "FILE.png", &flags->output, ParseText,
          "the picture, a PNG; with %d or {} in its name one for each frame, numbered from 0");
  AddRequestFlags(app, &flags->request);
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
  return {.name = "render",
          .summary = "Renders an isosurface of a volume, a dataset or a server's dataset to a PNG",
          .usage = "INPUT | DIR | --server HOST:PORT --isovalue V --output FILE.png [OPTIONS]",
          .examples =
              "  isoscope render head.nii.gz --isovalue 60 --azimuth 30 --output head.png\n"
              "  isoscope render --server localhost:50051 --isovalue 60 --repeat 36 --orbit 10 \\\n"
              "    --output turn-%d.png --stats turn.json\n",
          .register_flags = RegisterFlags};
}

}  // namespace isoscope::cli
