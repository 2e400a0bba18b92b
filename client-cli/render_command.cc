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

#include "client-cli/camera_file.h"
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
#include "client-cli/view_flags.h"
#include "core/base/status_macros.h"
#include "core/rpc/proto_convert.h"

namespace isoscope::cli {
namespace {

constexpr std::int64_t kMaxRepeatCount = 1'000'000;

struct RenderFlags {
  SessionFlags session;
  RequestFlags request;
  ViewFlags view;
  std::optional<std::string> output;
  std::optional<std::string> stats;
  std::optional<std::int64_t> repeat_count;
  std::optional<double> orbit_degrees;
};

absl::Status CheckUsage(const RenderFlags& flags) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.session));
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.request));
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.view, flags.request.camera));
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
  if (flags.view.save_camera_file) {
    ISOSCOPE_RETURN_IF_ERROR(CheckWritable(*flags.view.save_camera_file));
  }
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

// The request of frame `i`, whose camera is `first` turned on.
absl::StatusOr<isoscope::v1::RenderIsosurfaceRequest> MakeFrameRequest(
    const RenderFlags& flags, const std::string& dataset, const isoscope::v1::Camera& first,
    int i) {
  ISOSCOPE_ASSIGN_OR_RETURN(const view::Camera camera, rpc::CameraFromProto(first, "camera"));
  isoscope::v1::RenderIsosurfaceRequest request = MakeRequest(flags.request, dataset, camera);
  // All but the eye has the very bits of the first camera, which may come from a file.
  *request.mutable_camera() = first;
  const double orbit_degrees = flags.orbit_degrees.value_or(0);
  if (i > 0 && orbit_degrees != 0) {
    *request.mutable_camera()->mutable_eye() =
        rpc::ToProto(OrbitCamera(camera, orbit_degrees, i).eye);
  }
  if (flags.view.fit) {
    request.set_camera_fit(*flags.view.fit);
  }
  return request;
}

absl::Status Run(const RenderFlags& flags, const Context& context) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags));
  ISOSCOPE_RETURN_IF_ERROR(CheckOutputs(flags));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<Session> session,
                            Session::Open(flags.session, flags.request.viewport(), context));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const isoscope::v1::Dataset dataset,
      session->client().GetDataset(session->dataset_name(), session->timeout()));
  WarnIfNoSurface(dataset, flags.request.isovalue.value_or(0), context);
  ISOSCOPE_ASSIGN_OR_RETURN(const isoscope::v1::Camera camera,
                            ResolveView(flags.view, flags.request.camera, dataset));

  const auto frame_count = static_cast<int>(flags.repeat_count.value_or(1));
  const bool has_file_for_each_frame =
      FrameFileName(*flags.output, 0) != FrameFileName(*flags.output, 1);
  std::vector<FrameRecord> frames;
  for (int i = 0; i < frame_count; ++i) {
    ISOSCOPE_ASSIGN_OR_RETURN(const isoscope::v1::RenderIsosurfaceRequest request,
                              MakeFrameRequest(flags, dataset.name(), camera, i));
    const absl::Time start = absl::Now();
    ISOSCOPE_ASSIGN_OR_RETURN(isoscope::v1::RenderIsosurfaceResponse response,
                              session->client().RenderIsosurface(request, session->timeout()));
    frames.push_back({.wall_ms = absl::ToDoubleMilliseconds(absl::Now() - start),
                      .statistics = std::move(*response.mutable_statistics())});
    if (i == 0 && flags.view.save_camera_file) {
      ISOSCOPE_RETURN_IF_ERROR(
          WriteFileAtomically(*flags.view.save_camera_file, CameraToJson(response.camera())));
    }
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
  AddViewFlags(app, &flags->view);
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
