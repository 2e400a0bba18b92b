// isoscope render INPUT | DIR | --server HOST:PORT --isovalue V --output FILE.png
// isoscope render INPUT | DIR | --server HOST:PORT --like FILE.png --output FILE.png

#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"

#include "client-cli/annotations.h"
#include "client-cli/camera_flags.h"
#include "client-cli/command.h"
#include "client-cli/flags.h"
#include "client-cli/frame_statistics.h"
#include "client-cli/like_picture.h"
#include "client-cli/no_surface.h"
#include "client-cli/output.h"
#include "client-cli/picture_output.h"
#include "client-cli/png_metadata.h"
#include "client-cli/render_request.h"
#include "client-cli/session.h"
#include "client-cli/sweep.h"
#include "client-cli/usage.h"
#include "core/base/status_macros.h"
#include "core/rpc/proto_convert.h"

namespace isoscope::cli {
namespace {

struct RenderFlags {
  SessionFlags session;
  RequestFlags request;
  SweepFlags sweep;
  std::optional<std::string> output;
  std::optional<std::string> stats;
  std::optional<std::string> like;
  bool has_no_metadata = false;
  AnnotationFlags annotations;
};

absl::Status CheckUsage(const RenderFlags& flags, const CLI::App& app) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.session));
  if (!flags.like) {
    ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.request));
  }
  if (!flags.output) {
    return UsageError("--output FILE.png is missing: the picture to write");
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckPicturePath(*flags.output, flags.request.viewport()));
  if (!flags.like) {
    return CheckUsage(flags.sweep, *flags.output);
  }
  if (flags.request.culling == frame::Culling::kMask) {
    return UsageError("--culling mask can't be used with --like: it is approximate");
  }
  if (IsAnimationName(*flags.output)) {
    return UsageError("--like makes one picture again; --output must not be an animation");
  }
  return CheckOnlyFlagsBesideLike(app);
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

// The dataset, and what the record of its pictures says of it.
struct Subject {
  isoscope::v1::Dataset dataset;
  std::string picture_revision;
};

absl::StatusOr<Subject> FindSubject(Session* session) {
  Subject subject;
  ISOSCOPE_ASSIGN_OR_RETURN(
      subject.dataset, session->client().GetDataset(session->dataset_name(), session->timeout()));
  ISOSCOPE_ASSIGN_OR_RETURN(const isoscope::v1::GetClusterStatusResponse cluster,
                            session->client().GetClusterStatus(session->timeout()));
  subject.picture_revision = PictureRevisionOf(cluster, subject.dataset);
  return subject;
}

PictureOutput MakeOutput(const RenderFlags& flags, const Subject& subject) {
  return PictureOutput({.path = *flags.output,
                        .frame_count = flags.sweep.frame_count(),
                        .fps = flags.sweep.fps(),
                        .has_metadata = !flags.has_no_metadata,
                        .annotations = flags.annotations,
                        .picture_revision = subject.picture_revision,
                        .samples_digest = subject.dataset.samples_digest()});
}

// Renders one frame and remembers its statistics.
absl::StatusOr<isoscope::v1::RenderIsosurfaceResponse> RenderFrame(
    const isoscope::v1::RenderIsosurfaceRequest& request, Session* session,
    std::vector<FrameRecord>* frames) {
  const absl::Time start = absl::Now();
  ISOSCOPE_ASSIGN_OR_RETURN(isoscope::v1::RenderIsosurfaceResponse response,
                            session->client().RenderIsosurface(request, session->timeout()));
  frames->push_back({.wall_ms = absl::ToDoubleMilliseconds(absl::Now() - start),
                     .statistics = response.statistics()});
  return response;
}

// The stream for text: standard error if the statistics go to standard output.
std::ostream& TextOut(const RenderFlags& flags, const Context& context) {
  return flags.stats == "-" ? *context.err : *context.out;
}

absl::Status RunFrames(const RenderFlags& flags, Session* session, const Context& context) {
  ISOSCOPE_ASSIGN_OR_RETURN(const Subject subject, FindSubject(session));
  const isoscope::v1::Dataset& dataset = subject.dataset;
  ISOSCOPE_ASSIGN_OR_RETURN(const volume::GridGeometry geometry,
                            rpc::GeometryFromProto(dataset.geometry(), "dataset.geometry"));
  ISOSCOPE_ASSIGN_OR_RETURN(const view::Camera camera,
                            ResolveCamera(flags.request.camera, geometry.Bounds()));
  PictureOutput output = MakeOutput(flags, subject);
  std::vector<FrameRecord> frames;
  const int frame_count = flags.sweep.frame_count();
  {
    FrameProgress progress(frame_count, context.err, context.err_is_terminal);
    for (int i = 0; i < frame_count; ++i) {
      const RequestFlags of_frame = RequestOfFrame(flags.sweep, flags.request, i);
      if (i == 0 || flags.sweep.is_isovalue_sweep()) {
        WarnIfNoSurface(dataset, of_frame.isovalue.value_or(0), context);
      }
      const isoscope::v1::RenderIsosurfaceRequest request =
          MakeRequest(of_frame, dataset.name(), CameraOfFrame(flags.sweep, camera, i));
      ISOSCOPE_ASSIGN_OR_RETURN(const isoscope::v1::RenderIsosurfaceResponse response,
                                RenderFrame(request, session, &frames));
      ISOSCOPE_RETURN_IF_ERROR(output.Write(i, request, response));
      progress.Update(i + 1);
    }
    ISOSCOPE_RETURN_IF_ERROR(output.Finish());
  }
  ISOSCOPE_RETURN_IF_ERROR(WriteStatistics(flags, frames, context));
  const std::string name = FrameFileName(*flags.output, frame_count - 1);
  TextOut(flags, context) << DescribeStatistics(frames) << "\n"
                          << name << ": " << flags.request.viewport().width_px << " x "
                          << flags.request.viewport().height_px << " pixels"
                          << (IsAnimationName(name) ? absl::StrCat(", ", frame_count, " frames")
                                                    : std::string())
                          << "\n";
  return absl::OkStatus();
}

// Makes a picture again from its record and says how the two compare.
absl::Status RunLike(const RenderFlags& flags, const RecordedPng& recorded, Session* session,
                     const Context& context) {
  ISOSCOPE_ASSIGN_OR_RETURN(const Subject subject, FindSubject(session));
  ISOSCOPE_RETURN_IF_ERROR(CheckSameSamples(recorded.record, subject.dataset));
  isoscope::v1::RenderIsosurfaceRequest request = recorded.record.request;
  request.set_dataset(subject.dataset.name());
  request.set_culling(rpc::ToProto(flags.request.culling.value_or(frame::Culling::kDepth)));
  std::vector<FrameRecord> frames;
  ISOSCOPE_ASSIGN_OR_RETURN(const isoscope::v1::RenderIsosurfaceResponse response,
                            RenderFrame(request, session, &frames));
  PictureOutput output = MakeOutput(flags, subject);
  ISOSCOPE_RETURN_IF_ERROR(output.Write(0, request, response));
  ISOSCOPE_RETURN_IF_ERROR(output.Finish());
  ISOSCOPE_RETURN_IF_ERROR(WriteStatistics(flags, frames, context));
  ISOSCOPE_ASSIGN_OR_RETURN(const PictureComparison comparison,
                            ComparePictures(recorded, response.png()));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::string text,
      DescribeComparison(comparison, *flags.like, recorded.record.picture_revision,
                         subject.picture_revision));
  TextOut(flags, context) << FrameFileName(*flags.output, 0) << ": " << text << "\n";
  return absl::OkStatus();
}

absl::Status Run(const RenderFlags& flags, const CLI::App& app, const Context& context) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags, app));
  ISOSCOPE_RETURN_IF_ERROR(CheckOutputs(flags));
  if (flags.like) {
    // Read before anything is written: the output may be the same file.
    ISOSCOPE_ASSIGN_OR_RETURN(const RecordedPng recorded, ReadRecordedPng(*flags.like));
    ISOSCOPE_ASSIGN_OR_RETURN(
        const view::Viewport viewport,
        rpc::ViewportFromProto(recorded.record.request.viewport(), "viewport"));
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<Session> session,
                              Session::Open(flags.session, viewport, context));
    return RunLike(flags, recorded, session.get(), context);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<Session> session,
                            Session::Open(flags.session, flags.request.viewport(), context));
  return RunFrames(flags, session.get(), context);
}

Action RegisterFlags(CLI::App* app) {
  const auto flags = std::make_shared<RenderFlags>();
  AddSessionFlags(app, &flags->session);
  AddRendererFlag(app, &flags->session);
  AddFlag(app, "--output", "FILE.png", &flags->output, ParseText,
          "the picture, a PNG; with %d or {} in its name one for each frame, numbered from 0; all "
          "frames as one animation if it ends in .apng or .webp");
  AddRequestFlags(app, &flags->request);
  AddSweepFlags(app, &flags->sweep, &flags->request);
  AddFlag(app, "--stats", "FILE|-", &flags->stats, ParseText,
          "write statistics as JSON (- is standard output)");
  AddFlag(app, "--like", "FILE.png", &flags->like, ParseText,
          "make the picture in FILE.png again, from the record that render keeps in its pictures, "
          "and compare; takes no flag that decides a pixel");
  app->add_flag("--no-metadata", flags->has_no_metadata,
                "write pictures without a record of how they were made");
  AddAnnotationFlags(app, &flags->annotations);
  return [flags, app](const Context& context) { return Run(*flags, *app, context); };
}

}  // namespace

Command RenderCommand() {
  return {.name = "render",
          .summary = "Renders an isosurface of a volume, a dataset or a server's dataset to a PNG",
          .usage =
              "INPUT | DIR | --server HOST:PORT {--isovalue V | --like FILE.png} --output FILE.png "
              "[OPTIONS]",
          .examples =
              "  isoscope render head.nii.gz --isovalue 60 --azimuth 30 --output head.png\n"
              "  isoscope render --server localhost:50051 --isovalue 60 --repeat 36 --orbit 10 \\\n"
              "    --output turn-%d.png --stats turn.json\n"
              "  isoscope render head.nii.gz --isovalue 20:120:5 --output levels.webp\n"
              "  isoscope render head.nii.gz --like head.png --output again.png\n",
          .register_flags = RegisterFlags};
}

}  // namespace isoscope::cli
