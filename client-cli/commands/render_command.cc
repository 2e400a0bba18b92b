// isoscope render INPUT | DIR | --server HOST:PORT --isovalue V --output FILE.png
// isoscope render INPUT | DIR | --server HOST:PORT --like FILE.png --output FILE.png

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"

#include "client-cli/commands/program.h"
#include "client-cli/output/annotation_flags.h"
#include "client-cli/output/frame_name.h"
#include "client-cli/output/frame_statistics.h"
#include "client-cli/output/no_surface.h"
#include "client-cli/output/picture_output.h"
#include "client-cli/output/plane_flags.h"
#include "client-cli/output/sweep.h"
#include "client-cli/output/trace_file.h"
#include "client-cli/session/session.h"
#include "client-cli/terminal/show_picture.h"
#include "clients/cpp/connection/like_picture.h"
#include "clients/cpp/connection/png_metadata.h"
#include "clients/cpp/connection/render_frame.h"
#include "clients/cpp/connection/service_client.h"
#include "clients/cpp/picture_file/annotations.h"
#include "clients/cpp/picture_file/picture_scaling.h"
#include "clients/cpp/picture_file/poster.h"
#include "clients/cpp/request/camera_file.h"
#include "clients/cpp/request/camera_flags.h"
#include "clients/cpp/request/effect_flags.h"
#include "clients/cpp/request/look_flags.h"
#include "clients/cpp/request/render_request.h"
#include "clients/cpp/request/view_flags.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/cli/format.h"
#include "core/cli/progress_line.h"
#include "core/cli/usage.h"
#include "core/cli/waiting_line.h"
#include "core/frame/drawn_window.h"
#include "core/image/jpeg_codec.h"
#include "core/image/png_codec.h"
#include "core/io/atomic_file.h"
#include "core/rpc/frame_convert.h"
#include "core/rpc/proto_convert.h"
#include "isoscope/v1/cluster_service.pb.h"
#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::cli {
namespace {

namespace v1 = isoscope::v1;

struct RenderFlags {
  SessionFlags session;
  client::RequestFlags request;
  SweepFlags sweep;
  PlaneFlags planes;
  client::EffectFlags effects;
  client::ViewFlags view;
  client::LookFlags look;
  std::optional<std::string> output;
  std::optional<std::string> stats;
  std::optional<std::string> like;
  std::optional<ShowMode> show;
  std::optional<std::string> trace;
  bool has_no_metadata = false;
  bool allow_partial = false;
  bool is_quiet = false;
  std::optional<std::string> dataset_id;
  client::Annotations annotations;
};

// Whether the picture is drawn region by region.
bool IsPoster(const RenderFlags& flags) {
  const view::Viewport viewport = flags.request.viewport();
  const view::Viewport drawn = flags.effects.drawn_size(viewport);
  return !flags.request.region &&
         (client::NeedsRegions(viewport) ||
          std::max(drawn.width_px, drawn.height_px) > view::kMaxViewportPx);
}

view::Viewport PosterRegionSize(const RenderFlags& flags) {
  return client::RegionSizeOf(flags.request.viewport(), flags.effects.max_region_side_px());
}

bool IsJpeg(const RenderFlags& flags) {
  return flags.output && IsJpegName(FrameFileName(*flags.output, 0));
}

// UsageError if the output's format does not fit what is asked for beside it.
absl::Status CheckFormat(const RenderFlags& flags) {
  if (!flags.output) {
    return absl::OkStatus();
  }
  if (!IsJpeg(flags)) {
    return CheckPicturePath(*flags.output, flags.request.image_size());
  }
  if (flags.annotations.any()) {
    return UsageError(
        "annotations are drawn on pictures without loss: --output must not be a JPEG");
  }
  return absl::OkStatus();
}

// UsageError for what a picture can't have that is drawn region by region.
absl::Status CheckPoster(const RenderFlags& flags) {
  if (!IsPoster(flags)) {
    return absl::OkStatus();
  }
  const std::string size = absl::StrCat(flags.request.viewport().width_px, " x ",
                                        flags.request.viewport().height_px, " pixels");
  if (!flags.output) {
    return UsageError(absl::StrCat("--output FILE.png is missing: a picture of ", size,
                                   " is written while it is drawn"));
  }
  if (IsJpeg(flags) || flags.planes.files.any_plane()) {
    return UsageError(absl::StrCat(
        "a picture of ", size, " is drawn in regions into a PNG: ",
        IsJpeg(flags) ? "--output must end in .png" : "planes are written of a --region of it"));
  }
  if (flags.sweep.frame_count() > 1) {
    return UsageError(
        absl::StrCat("a picture of ", size, " is drawn in regions, one picture at a time: leave ",
                     flags.sweep.is_isovalue_sweep() ? "the sweep of --isovalue" : "--repeat",
                     " out, or ask for at most ", client::kMaxSinglePixels, " pixels"));
  }
  if (flags.view.save_camera_file) {
    return UsageError(absl::StrCat(
        "a picture of ", size, " is drawn in regions: --save-camera is for pictures of at most ",
        client::kMaxSinglePixels, " pixels"));
  }
  if (flags.trace) {
    return UsageError(absl::StrCat("a picture of ", size,
                                   " is drawn in regions: --trace is for one frame, as a --region "
                                   "of it is"));
  }
  if (flags.allow_partial) {
    return UsageError(absl::StrCat("a picture of ", size,
                                   " is drawn in regions, of which each could lack other shards: "
                                   "leave --allow-partial out"));
  }
  if (flags.annotations.any()) {
    return UsageError(absl::StrCat("a picture of ", size,
                                   " is drawn in regions: annotations are drawn on pictures of at "
                                   "most ",
                                   client::kMaxSinglePixels, " pixels"));
  }
  return absl::OkStatus();
}

// Standard output has room for one: the statistics, or the picture.
ShowMode ShowModeOf(const RenderFlags& flags) {
  return flags.show.value_or(flags.stats == "-" ? ShowMode::kNever : ShowMode::kAuto);
}

absl::Status CheckShow(const RenderFlags& flags, const Context& context) {
  const ShowMode mode = ShowModeOf(flags);
  if (flags.stats == "-" && mode != ShowMode::kNever) {
    return UsageError("--show and --stats - both write to standard output: leave one out");
  }
  const bool may_show = IsFormat(mode) || (mode == ShowMode::kAuto && context.out_columns > 0);
  if (!flags.output && (flags.like || (!flags.planes.files.any_plane() && !may_show))) {
    return UsageError("--output FILE.png is missing: the picture to write");
  }
  return absl::OkStatus();
}

absl::Status CheckUsage(const RenderFlags& flags, const FlagSet& set, const Context& context) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.session));
  if (!flags.like) {
    ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.request));
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckShow(flags, context));
  ISOSCOPE_RETURN_IF_ERROR(CheckFormat(flags));
  if (!flags.like) {
    ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.view, flags.request.camera));
    ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.planes, flags.output));
    ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.look, flags.request.isovalues().size()));
    if (flags.planes.files.any_plane() && flags.sweep.frame_count() > 1) {
      return UsageError("planes are written of one picture: leave --repeat and sweeps out");
    }
    if (flags.trace && flags.sweep.frame_count() > 1) {
      return UsageError("--trace is for one frame: leave --repeat and sweeps out");
    }
    if (flags.annotations.has_legend && flags.look.color_by.empty()) {
      return UsageError("--legend shows what the colours of --color-by mean: give that too");
    }
    ISOSCOPE_RETURN_IF_ERROR(CheckPoster(flags));
    return CheckUsage(flags.sweep, flags.output.value_or(""));
  }
  if (flags.request.culling == frame::Culling::kMask) {
    return UsageError("--culling mask can't be used with --like: it is approximate");
  }
  if (client::IsAnimationName(*flags.output) || IsJpeg(flags)) {
    return UsageError("--like makes one picture again: --output must end in .png");
  }
  return client::CheckOnlyFlagsBesideLike(set);
}

// Finds out before any work whether its result can be kept.
absl::Status CheckOutputs(const RenderFlags& flags) {
  if (flags.output) {
    ISOSCOPE_RETURN_IF_ERROR(io::CheckWritable(FrameFileName(*flags.output, 0)));
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckWritable(flags.planes));
  if (flags.view.save_camera_file) {
    ISOSCOPE_RETURN_IF_ERROR(io::CheckWritable(*flags.view.save_camera_file));
  }
  if (flags.trace) {
    ISOSCOPE_RETURN_IF_ERROR(io::CheckWritable(*flags.trace));
  }
  return flags.stats && *flags.stats != "-" ? io::CheckWritable(*flags.stats) : absl::OkStatus();
}

absl::Status WriteStatistics(const RenderFlags& flags, const std::vector<FrameRecord>& frames,
                             const Context& context) {
  if (!flags.stats) {
    return absl::OkStatus();
  }
  const std::string json = StatisticsJson(frames);
  if (*flags.stats == "-") {
    *context.out << json;
    return absl::OkStatus();
  }
  return io::WriteFileAtomically(*flags.stats, json);
}

// The dataset, and what the record of its pictures says of it.
struct Subject {
  isoscope::v1::Dataset dataset;
  std::string picture_revision;
};

absl::StatusOr<Subject> FindSubject(Session* session) {
  Subject subject;
  ISOSCOPE_ASSIGN_OR_RETURN(
      subject.dataset,
      session->client().GetDataset(session->dataset_name(), session->question_timeout()));
  ISOSCOPE_ASSIGN_OR_RETURN(const isoscope::v1::GetClusterStatusResponse cluster,
                            session->client().GetClusterStatus(session->question_timeout()));
  subject.picture_revision = client::PictureRevisionOf(cluster, subject.dataset);
  return subject;
}

PictureOutput MakeOutput(const RenderFlags& flags, const Subject& subject) {
  return PictureOutput({.path = flags.output.value_or(""),
                        .frame_count = flags.sweep.frame_count(),
                        .fps = flags.sweep.fps(),
                        .has_metadata = !flags.has_no_metadata,
                        .annotations = flags.annotations,
                        .patient_frame = subject.dataset.patient_frame(),
                        .picture_revision = subject.picture_revision,
                        .samples_digest = subject.dataset.samples_digest()});
}

// Renders one frame, remembers its statistics and writes its trace.
absl::StatusOr<v1::RenderIsosurfaceResponse> RenderFrame(
    const v1::RenderIsosurfaceRequest& plain_request, const std::optional<std::string>& trace_path,
    Session* session, std::vector<FrameRecord>* frames, bool says_waiting, const Context& context) {
  v1::RenderIsosurfaceRequest request = plain_request;
  request.set_with_trace(trace_path.has_value());
  const absl::Time start = absl::Now();
  const WaitingLine waiting(context.err, says_waiting && context.err_is_terminal, "rendering");
  ISOSCOPE_ASSIGN_OR_RETURN(
      v1::RenderIsosurfaceResponse response,
      client::RenderFrame(request, session->frame_timeout(), &session->client()));
  frames->push_back({.wall_ms = absl::ToDoubleMilliseconds(absl::Now() - start),
                     .statistics = response.statistics()});
  if (trace_path) {
    ISOSCOPE_RETURN_IF_ERROR(
        io::WriteFileAtomically(*trace_path, TraceToJson(response.trace(), absl::Now() - start)));
  }
  return response;
}

// Says if translucent layers were left out.
void WarnIfTruncated(const std::vector<FrameRecord>& frames, const RenderFlags& flags,
                     const Context& context) {
  std::int64_t most = 0;
  for (const FrameRecord& frame : frames) {
    most = std::max(most, frame.statistics.truncated_pixel_count());
  }
  if (most > 0) {
    const std::int64_t limit = flags.request.max_layers.value_or(frame::kDefaultLayers);
    *context.err << "isoscope: " << FormatCount(most) << " pixels have more than " << limit
                 << " translucent layers; the farthest do not show"
                 << (limit < frame::kMaxLayers
                         ? absl::StrCat(" (--max-layers allows up to ", frame::kMaxLayers, ")")
                         : std::string())
                 << std::endl;
  }
}

// Says which frames lack shards, also with --quiet.
void WarnIfPartial(const std::vector<FrameRecord>& frames, const Context& context) {
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const std::string missing = DescribeMissingShards(frames[i].statistics);
    if (!missing.empty()) {
      *context.err << "isoscope: " << (frames.size() > 1 ? absl::StrCat("frame ", i, ": ") : "")
                   << missing << std::endl;
    }
  }
}

// The stream for text: standard error if the statistics, or the bytes of the picture that a file
// takes, go to standard output; nowhere with --quiet.
std::ostream& TextOut(const RenderFlags& flags, const Context& context) {
  if (flags.is_quiet) {
    return *QuietContext(context).out;
  }
  const bool is_taken =
      flags.stats == "-" || (IsFormat(ShowModeOf(flags)) && context.out_columns == 0);
  return is_taken ? *context.err : *context.out;
}

// Shows the last picture, if there is one.
absl::Status ShowFrame(const PictureDisplay& display, const PictureOutput& output,
                       const v1::RenderIsosurfaceResponse& response, const Context& context) {
  if (!display.is_on() || (output.last_png().empty() && response.jpeg().empty())) {
    return absl::OkStatus();
  }
  ISOSCOPE_ASSIGN_OR_RETURN(image::RgbaImage picture, output.last_png().empty()
                                                          ? image::DecodeJpeg(response.jpeg())
                                                          : image::DecodePng(output.last_png()));
  const view::Viewport size = display.SizeOf({picture.width, picture.height});
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string bytes,
                            display.Encode(client::ScalePicture(std::move(picture), size)));
  *context.out << bytes << std::flush;
  return absl::OkStatus();
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

// Renders a picture that is too large for one frame, region by region.
absl::Status RunPoster(const RenderFlags& flags, const v1::RenderIsosurfaceRequest& whole,
                       const PictureDisplay& display, Session* session, const Context& context) {
  const absl::Time start = absl::Now();
  const view::Viewport viewport = flags.request.viewport();
  std::vector<FrameRecord> regions;
  v1::RenderIsosurfaceRequest of_region = whole;
  of_region.mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_RGBA8);
  std::optional<client::PictureScaler> shown;
  if (display.is_on()) {
    shown.emplace(viewport, display.SizeOf(viewport));
  }
  const auto render = [&](const view::Region& region) -> absl::StatusOr<image::RgbaImage> {
    *of_region.mutable_region() = rpc::ToProto(region);
    const absl::Time region_start = absl::Now();
    ISOSCOPE_ASSIGN_OR_RETURN(
        v1::RenderIsosurfaceResponse response,
        session->client().RenderIsosurface(of_region, session->frame_timeout()));
    // The server finds the camera once: the other regions have the one that it used.
    *of_region.mutable_camera() = response.camera();
    of_region.clear_camera_fit();
    regions.push_back({.wall_ms = absl::ToDoubleMilliseconds(absl::Now() - region_start),
                       .statistics = std::move(*response.mutable_statistics())});
    absl::StatusOr<image::RgbaImage> image = ImageOfRaw(response);
    if (image.ok() && shown) {
      shown->Add(region.x, region.y, *image);
    }
    return image;
  };
  const std::string path = FrameFileName(*flags.output, 0);
  const bool is_opaque = !whole.has_background_color() || whole.background_color().alpha() == 1.0F;
  std::int64_t size_bytes = 0;
  {
    ProgressLine line(context.err, context.err_is_terminal);
    ISOSCOPE_ASSIGN_OR_RETURN(
        size_bytes, client::WritePoster(viewport, PosterRegionSize(flags), is_opaque, path, render,
                                        [&](absl::string_view text) { line.Update(text); }));
  }
  ISOSCOPE_RETURN_IF_ERROR(WriteStatistics(flags, regions, context));
  if (shown) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::string bytes, display.Encode(shown->Finish()));
    *context.out << bytes << std::flush;
  }
  TextOut(flags, context) << path << ": " << viewport.width_px << " x " << viewport.height_px
                          << " pixels in " << FormatCount(static_cast<std::int64_t>(regions.size()))
                          << " regions, " << FormatMebibytes(size_bytes) << ", in "
                          << FormatElapsed(absl::Now() - start) << "\n";
  return absl::OkStatus();
}

// Writes the pictures of frames, and planes.
absl::Status WriteFrame(const RenderFlags& flags, int frame_index,
                        const v1::RenderIsosurfaceRequest& request,
                        const v1::RenderIsosurfaceResponse& response, PictureOutput* output) {
  if (IsJpeg(flags)) {
    if (HasFrameNumber(*flags.output) || frame_index + 1 == flags.sweep.frame_count()) {
      ISOSCOPE_RETURN_IF_ERROR(
          io::WriteFileAtomically(FrameFileName(*flags.output, frame_index), response.jpeg()));
    }
  } else if (flags.output || !flags.planes.files.any_plane()) {
    ISOSCOPE_RETURN_IF_ERROR(output->Write(frame_index, request, response));
  }
  return client::WritePlanes(flags.planes.files, response);
}

// The request of frame `i`, whose camera is `first` turned on.
absl::StatusOr<v1::RenderIsosurfaceRequest> MakeFrameRequest(const RenderFlags& flags,
                                                             const client::RequestFlags& of_frame,
                                                             const std::string& dataset,
                                                             const v1::Camera& first, int i) {
  ISOSCOPE_ASSIGN_OR_RETURN(v1::RenderIsosurfaceRequest request,
                            client::MakeRequest(of_frame, dataset, first));
  if (i > 0 && flags.sweep.orbit_degrees.value_or(0) != 0) {
    // All but the eye has the very bits of the first camera.
    ISOSCOPE_ASSIGN_OR_RETURN(const view::Camera camera, rpc::CameraFromProto(first, "camera"));
    *request.mutable_camera()->mutable_eye() =
        rpc::ToProto(CameraOfFrame(flags.sweep, camera, i).eye);
  }
  if (flags.view.fit) {
    request.set_camera_fit(*flags.view.fit);
  }
  client::SetEffects(flags.effects, &request);
  client::AddLook(flags.look, &request);
  request.set_allow_partial(flags.allow_partial);
  request.set_dataset_id(flags.dataset_id.value_or(""));
  if (IsJpeg(flags) || flags.planes.files.any_plane()) {
    *request.mutable_output() = MakeOutputOptions(flags.planes, flags.output);
  }
  return request;
}

absl::Status RunFrames(const RenderFlags& flags, const PictureDisplay& display, Session* session,
                       const Context& context) {
  ISOSCOPE_ASSIGN_OR_RETURN(const Subject subject, FindSubject(session));
  const v1::Dataset& dataset = subject.dataset;
  ISOSCOPE_ASSIGN_OR_RETURN(const v1::Camera camera,
                            client::ResolveView(flags.view, flags.request.camera, dataset));
  if (IsPoster(flags)) {
    for (const double isovalue : flags.request.isovalues()) {
      WarnIfNoSurface(dataset, isovalue, context);
    }
    ISOSCOPE_ASSIGN_OR_RETURN(
        const v1::RenderIsosurfaceRequest whole,
        MakeFrameRequest(flags, flags.request, dataset.name(), camera, /*i=*/0));
    return RunPoster(flags, whole, display, session, context);
  }
  PictureOutput output = MakeOutput(flags, subject);
  std::vector<FrameRecord> frames;
  v1::RenderIsosurfaceResponse last;
  const int frame_count = flags.sweep.frame_count();
  {
    FrameProgress progress(frame_count, context.err, context.err_is_terminal);
    for (int i = 0; i < frame_count; ++i) {
      const client::RequestFlags of_frame = RequestOfFrame(flags.sweep, flags.request, i);
      if (i == 0 || flags.sweep.is_isovalue_sweep()) {
        for (const double isovalue : of_frame.isovalues()) {
          WarnIfNoSurface(dataset, isovalue, context);
        }
      }
      ISOSCOPE_ASSIGN_OR_RETURN(const v1::RenderIsosurfaceRequest request,
                                MakeFrameRequest(flags, of_frame, dataset.name(), camera, i));
      ISOSCOPE_ASSIGN_OR_RETURN(v1::RenderIsosurfaceResponse response,
                                RenderFrame(request, flags.trace, session, &frames,
                                            /*says_waiting=*/frame_count == 1, context));
      if (i == 0 && flags.view.save_camera_file) {
        ISOSCOPE_RETURN_IF_ERROR(io::WriteFileAtomically(*flags.view.save_camera_file,
                                                         client::CameraToJson(response.camera())));
      }
      ISOSCOPE_RETURN_IF_ERROR(WriteFrame(flags, i, request, response, &output));
      progress.Update(i + 1);
      last = std::move(response);
    }
    ISOSCOPE_RETURN_IF_ERROR(output.Finish());
  }
  ISOSCOPE_RETURN_IF_ERROR(ShowFrame(display, output, last, context));
  ISOSCOPE_RETURN_IF_ERROR(WriteStatistics(flags, frames, context));
  WarnIfTruncated(frames, flags, context);
  WarnIfPartial(frames, context);
  const std::string name = flags.output ? FrameFileName(*flags.output, frame_count - 1)
                           : flags.planes.files.any_plane() ? "planes"
                                                            : "picture";
  if (flags.stats) {
    TextOut(flags, context) << DescribeStatistics(frames, context.out_columns) << "\n";
  }
  TextOut(flags, context) << name << ": " << flags.request.image_size().width_px << " x "
                          << flags.request.image_size().height_px << " pixels"
                          << (client::IsAnimationName(name)
                                  ? absl::StrCat(", ", frame_count, " frames")
                                  : std::string())
                          << "\n";
  return absl::OkStatus();
}

// Makes a picture again from its record and says how the two compare.
absl::Status RunLike(const RenderFlags& flags, const client::RecordedPng& recorded,
                     const PictureDisplay& display, Session* session, const Context& context) {
  ISOSCOPE_ASSIGN_OR_RETURN(const Subject subject, FindSubject(session));
  ISOSCOPE_RETURN_IF_ERROR(client::CheckSameSamples(recorded.record, subject.dataset));
  isoscope::v1::RenderIsosurfaceRequest request = recorded.record.request;
  request.set_dataset(subject.dataset.name());
  request.set_culling(rpc::ToProto(flags.request.culling.value_or(frame::Culling::kDepth)));
  std::vector<FrameRecord> frames;
  ISOSCOPE_ASSIGN_OR_RETURN(const isoscope::v1::RenderIsosurfaceResponse response,
                            RenderFrame(request, flags.trace, session, &frames,
                                        /*says_waiting=*/true, context));
  PictureOutput output = MakeOutput(flags, subject);
  ISOSCOPE_RETURN_IF_ERROR(output.Write(0, request, response));
  ISOSCOPE_RETURN_IF_ERROR(output.Finish());
  ISOSCOPE_RETURN_IF_ERROR(ShowFrame(display, output, response, context));
  ISOSCOPE_RETURN_IF_ERROR(WriteStatistics(flags, frames, context));
  ISOSCOPE_ASSIGN_OR_RETURN(const client::PictureComparison comparison,
                            client::ComparePictures(recorded, response.png()));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::string text,
      client::DescribeComparison(comparison, *flags.like, recorded.record.picture_revision,
                                 subject.picture_revision));
  TextOut(flags, context) << FrameFileName(*flags.output, 0) << ": " << base::Printable(text)
                          << "\n";
  return absl::OkStatus();
}

// The size of the frames that agents will draw.
view::Viewport ExpectedSize(const RenderFlags& flags) {
  return flags.effects.drawn_size(IsPoster(flags) ? PosterRegionSize(flags)
                                                  : flags.request.image_size());
}

absl::Status Run(const RenderFlags& flags, const FlagSet& set, const Context& context) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags, set, context));
  ISOSCOPE_RETURN_IF_ERROR(CheckOutputs(flags));
  const PictureDisplay display = PictureDisplay::ForStandardOutput(ShowModeOf(flags), context);
  if (!flags.output && !flags.planes.files.any_plane() && !display.is_on()) {
    return UsageError("--output FILE.png is missing: this terminal shows no pictures");
  }
  if (flags.like) {
    // Read before anything is written: the output may be the same file.
    ISOSCOPE_ASSIGN_OR_RETURN(const client::RecordedPng recorded,
                              client::ReadRecordedPng(*flags.like));
    ISOSCOPE_ASSIGN_OR_RETURN(const frame::FrameSpec spec,
                              rpc::FrameSpecFromProto(recorded.record.request));
    ISOSCOPE_ASSIGN_OR_RETURN(
        const std::unique_ptr<Session> session,
        Session::Open(flags.session, frame::DrawnWindowOf(spec).image_size(), context));
    return RunLike(flags, recorded, display, session.get(), context);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<Session> session,
                            Session::Open(flags.session, ExpectedSize(flags), context));
  return RunFrames(flags, display, session.get(), context);
}

Action RegisterRenderFlags(FlagSet* set) {
  const auto flags = std::make_shared<RenderFlags>();
  AddSessionFlags(set, &flags->session);
  AddRendererFlag(set, &flags->session);
  AddFlag(
      set, "-o,--output", "FILE.png", &flags->output, ParseText,
      "the picture: a PNG, or a JPEG if it ends in .jpg; with %d, %03d or {} in its name one for "
      "each frame, numbered from 0, else the last one; all "
      "frames as one animation if it ends in .apng or .webp");
  client::AddRequestFlags(set, &flags->request);
  AddSweepFlags(set, &flags->sweep, &flags->request);
  AddPlaneFlags(set, &flags->planes);
  client::AddEffectFlags(set, &flags->effects);
  client::AddViewFlags(set, &flags->view);
  client::AddLookFlags(set, &flags->look);
  AddShowFlag(set, &flags->show,
              "show the picture in the terminal: auto (default) where standard output is one that "
              "can, or in a format whatever it is; --output may then be left out");
  AddFlag(set, "--stats", "FILE|-", &flags->stats, ParseText,
          "write statistics as JSON (- is standard output), and print them as tables");
  AddFlag(set, "--trace", "FILE.json", &flags->trace, ParseText,
          "write the times of the frame in coordinator and agents, for ui.perfetto.dev");
  AddFlag(set, "--like", "FILE.png", &flags->like, ParseText,
          "make the picture in FILE.png again, from the record that render keeps in its pictures, "
          "and compare; takes no flag that decides a pixel");
  set->AddSwitch("--no-metadata", &flags->has_no_metadata,
                 "write pictures without a record of how they were made");
  set->AddSwitch("--allow-partial", &flags->allow_partial,
                 "draw what there is if some shards are not served, and say what is missing; else "
                 "that is an error");
  AddFlag(set, "--dataset-id", "ID", &flags->dataset_id, ParseText,
          "fail if the dataset under that name has another id; `isoscope info` prints it");
  AddAnnotationFlags(set, &flags->annotations);
  AddQuietFlag(set, &flags->is_quiet);
  return [flags, set](const Context& context) {
    Context own = context;
    own.err_is_terminal = context.err_is_terminal && !flags->is_quiet;
    return Run(*flags, *set, own);
  };
}

}  // namespace

Command RenderCommand() {
  return {.name = "render",
          .summary = "Renders an isosurface of a volume, a dataset or a server's dataset to a PNG",
          .usage =
              "INPUT | DIR | --server HOST:PORT {--isovalue V | --like FILE.png} [--output "
              "FILE.png] [OPTIONS]",
          .examples =
              "  isoscope render head.nii.gz --isovalue 60 --azimuth 30 --output head.png\n"
              "  isoscope render head.nii.gz --isovalue 60          in the terminal\n"
              "  isoscope render --server localhost:50051 --isovalue 60 --repeat 36 --orbit 10 \\\n"
              "    --output turn-%03d.png --stats turn.json\n"
              "  isoscope render head.nii.gz --isovalue 20:120:5 --output levels.webp\n"
              "  isoscope render head.nii.gz --isovalue 60 --width 32768 --height 32768 \\\n"
              "    --renderer cpu --output poster.png\n"
              "  isoscope render head.nii.gz --isovalue 60 --output head.jpg --depth depth.npy\n"
              "  isoscope render head.nii.gz --isovalue 60 --light -1,1,2 --color-by z:turbo "
              "--legend \\\n"
              "    --output height.png\n"
              "  isoscope render head.nii.gz --like head.png --output again.png\n",
          .register_flags = RegisterRenderFlags};
}

}  // namespace isoscope::cli
