// isoscope render INPUT | DIR | --server HOST:PORT --isovalue V --output FILE.png
// isoscope render INPUT | DIR | --server HOST:PORT --like FILE.png --output FILE.png
//
// RunFrames renders one picture, or the frames of a sweep, each with one request. RunPoster renders
// a picture too large for one frame region by region. RunLike repeats a picture from its record.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <numeric>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"

#include "client-cli/commands/frame_measures.h"
#include "client-cli/commands/program.h"
#include "client-cli/commands/render_flags.h"
#include "client-cli/commands/small_frame.h"
#include "client-cli/commands/surface_notes.h"
#include "client-cli/output/frame_name.h"
#include "client-cli/output/frame_statistics.h"
#include "client-cli/output/note_lines.h"
#include "client-cli/output/picture_output.h"
#include "client-cli/output/sweep.h"
#include "client-cli/output/trace_file.h"
#include "client-cli/session/embedded_cluster.h"
#include "clients/cpp/connection/features.h"
#include "clients/cpp/connection/label_query.h"
#include "clients/cpp/connection/like_picture.h"
#include "clients/cpp/connection/png_metadata.h"
#include "clients/cpp/connection/render_frame.h"
#include "clients/cpp/connection/service_client.h"
#include "clients/cpp/picture_file/picture_scaling.h"
#include "clients/cpp/picture_file/poster.h"
#include "clients/cpp/request/camera_file.h"
#include "clients/cpp/request/dataset_fields.h"
#include "core/base/monotonic_time.h"
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
#include "isoscope/v1/cluster_service.pb.h"
#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "wire/frame_convert.h"
#include "wire/proto_convert.h"

namespace isoscope::cli {
namespace {

namespace v1 = isoscope::v1;

// Adds the measures of surfaces to the frames first, unless they are not wanted.
absl::Status WriteStatistics(const RenderFlags& flags, const v1::Dataset& dataset, Session* session,
                             std::vector<FrameRecord>* frames, const Context& context) {
  if (!flags.stats) {
    return absl::OkStatus();
  }
  if (!flags.has_no_measures) {
    std::vector<std::string> names;
    for (const client::LabelSurface& label : flags.request.label.surfaces) {
      names.push_back(label.name);
    }
    ISOSCOPE_RETURN_IF_ERROR(AddMeasures(dataset, names, session, frames, context));
  }
  const std::string json = StatisticsJson(*frames);
  if (*flags.stats == "-") {
    *context.out << json;
    return absl::OkStatus();
  }
  return io::WriteFileAtomically(*flags.stats, json);
}

// The dataset, and its description in the record of pictures.
struct Subject {
  v1::Dataset dataset;
  std::string picture_revision;
  bool has_notes = false;         // the server knows notes on surfaces
  bool has_unresolved = false;    // it counts what a level hides
  bool fits_cells = false;        // and CAMERA_FIT_CELLS
  bool has_color_ranges = false;  // and ranges of what is visible, and of percentiles
};

absl::StatusOr<Subject> FindSubject(Session* session) {
  Subject subject;
  ISOSCOPE_ASSIGN_OR_RETURN(subject.dataset, session->GetDataset());
  ISOSCOPE_ASSIGN_OR_RETURN(const v1::GetClusterStatusResponse cluster,
                            session->client().GetClusterStatus(session->question_timeout()));
  subject.picture_revision = client::PictureRevisionOf(cluster, subject.dataset);
  ISOSCOPE_ASSIGN_OR_RETURN(const client::Features features,
                            client::FeaturesOf(session->question_timeout(), &session->client()));
  subject.has_notes = features.count("notes") > 0;
  subject.has_unresolved = features.count("unresolved_count") > 0;
  subject.fits_cells = features.count("fit_cells") > 0;
  subject.has_color_ranges = features.count("color_ranges") > 0;
  return subject;
}

PictureOutput MakeOutput(const RenderFlags& flags, const Subject& subject, const Context& context) {
  return PictureOutput({.path = flags.output.value_or(""),
                        .out = context.out,
                        .frame_count = flags.sweep.frame_count(),
                        .fps = flags.sweep.fps(),
                        .has_metadata = !flags.has_no_metadata,
                        .annotations = flags.annotations,
                        .dataset = subject.dataset,
                        .picture_revision = subject.picture_revision});
}

// Not set: the request has no choice.
std::optional<v1::DrawnLevel> LevelOf(const v1::RenderIsosurfaceResponse& response) {
  return response.has_drawn_level() ? std::optional(response.drawn_level()) : std::nullopt;
}

// Renders one frame, records its statistics and writes its trace.
absl::StatusOr<v1::RenderIsosurfaceResponse> RenderFrame(
    const v1::RenderIsosurfaceRequest& plain_request, const std::optional<std::string>& trace_path,
    Session* session, std::vector<FrameRecord>* frames, bool says_waiting, const Context& context) {
  v1::RenderIsosurfaceRequest request = plain_request;
  request.set_with_trace(trace_path.has_value());
  const base::MonotonicTime start = base::MonotonicNow();
  const WaitingLine waiting(context.err, says_waiting && context.err_is_terminal, "rendering");
  ISOSCOPE_ASSIGN_OR_RETURN(
      v1::RenderIsosurfaceResponse response,
      client::RenderFrame(request, session->frame_timeout(), &session->client()));
  frames->push_back({.wall_ms = absl::ToDoubleMilliseconds(base::MonotonicNow() - start),
                     .statistics = response.statistics(),
                     .request = plain_request,
                     .drawn_level = LevelOf(response),
                     .notes = {response.notes().begin(), response.notes().end()}});
  if (trace_path) {
    ISOSCOPE_RETURN_IF_ERROR(io::WriteFileAtomically(
        *trace_path, TraceToJson(response.trace(), base::MonotonicNow() - start)));
  }
  return response;
}

// Warns if translucent layers were left out.
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

// Warns about frames that lack shards, also with --quiet.
void WarnIfPartial(const std::vector<FrameRecord>& frames, const Context& context) {
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const std::string missing = DescribeMissingShards(frames[i].statistics);
    if (!missing.empty()) {
      *context.err << "isoscope: " << (frames.size() > 1 ? absl::StrCat("frame ", i, ": ") : "")
                   << missing << std::endl;
    }
  }
}

// Returns the stream for text. It is standard error if the statistics, or the bytes of the picture,
// go to standard output. With --quiet it discards the text.
std::ostream& TextOut(const RenderFlags& flags, const Context& context) {
  if (flags.is_quiet) {
    return *QuietContext(context).out;
  }
  const bool is_taken = flags.stats == "-" || flags.is_to_stdout() ||
                        (IsFormat(flags.show_mode()) && context.out_columns == 0);
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

// Gives a poster the ranges of what is visible: regions have the colours of the whole. A smaller
// picture tells them.
absl::Status ResolveVisibleRanges(Session* session, v1::RenderIsosurfaceRequest* poster) {
  if (!client::HasVisibleRange(*poster)) {
    return absl::OkStatus();
  }
  v1::RenderIsosurfaceRequest small = SmallFrameOf(*poster, view::kCommonViewport.width_px);
  small.mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_NONE);
  small.mutable_output()->set_depth(true);
  ISOSCOPE_ASSIGN_OR_RETURN(const v1::RenderIsosurfaceResponse response,
                            session->client().RenderIsosurface(small, session->frame_timeout()));
  client::KeepRanges(response, poster);
  return absl::OkStatus();
}

// Renders a picture that is too large for one frame, region by region.
absl::Status RunPoster(const RenderFlags& flags, const v1::Dataset& dataset,
                       const v1::RenderIsosurfaceRequest& whole, const PictureDisplay& display,
                       Session* session, const Context& context) {
  const base::MonotonicTime start = base::MonotonicNow();
  const view::Viewport viewport = flags.request.viewport();
  std::vector<FrameRecord> regions;
  v1::RenderIsosurfaceRequest region_request = whole;
  region_request.mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_RGBA8);
  std::optional<client::PictureScaler> shown;
  if (display.is_on()) {
    shown.emplace(viewport, display.SizeOf(viewport));
  }
  const auto render = [&](const view::Region& region) -> absl::StatusOr<image::RgbaImage> {
    *region_request.mutable_region() = wire::ToProto(region);
    const base::MonotonicTime region_start = base::MonotonicNow();
    ISOSCOPE_ASSIGN_OR_RETURN(
        v1::RenderIsosurfaceResponse response,
        session->client().RenderIsosurface(region_request, session->frame_timeout()));
    // The server resolves the camera once: the other regions use the camera of the first.
    *region_request.mutable_camera() = response.camera();
    region_request.clear_camera_fit();
    if (response.has_drawn_level()) {
      region_request.mutable_level()->set_level(response.drawn_level().level());
    }
    regions.push_back({.wall_ms = absl::ToDoubleMilliseconds(base::MonotonicNow() - region_start),
                       .statistics = std::move(*response.mutable_statistics()),
                       .request = whole,
                       .drawn_level = LevelOf(response)});
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
        size_bytes, client::WritePoster(viewport, flags.region_size(), is_opaque, path, render,
                                        [&](absl::string_view text) { line.Update(text); }));
  }
  ISOSCOPE_RETURN_IF_ERROR(WriteStatistics(flags, dataset, session, &regions, context));
  if (shown) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::string bytes, display.Encode(shown->Finish()));
    *context.out << bytes << std::flush;
  }
  TextOut(flags, context) << path << ": " << viewport.width_px << " x " << viewport.height_px
                          << " pixels in " << FormatCount(static_cast<std::int64_t>(regions.size()))
                          << " regions, " << FormatMebibytes(size_bytes) << ", in "
                          << FormatElapsed(base::MonotonicNow() - start) << "\n";
  return absl::OkStatus();
}

// Writes the pictures of frames, and planes.
absl::Status WriteFrame(const RenderFlags& flags, int frame_index,
                        const v1::RenderIsosurfaceRequest& request,
                        const v1::RenderIsosurfaceResponse& response, PictureOutput* output) {
  if (flags.is_jpeg()) {
    if (HasFrameNumber(*flags.output) || frame_index + 1 == flags.sweep.frame_count()) {
      ISOSCOPE_RETURN_IF_ERROR(
          io::WriteFileAtomically(FrameFileName(*flags.output, frame_index), response.jpeg()));
    }
  } else if (flags.output || !flags.planes.files.any_plane()) {
    ISOSCOPE_RETURN_IF_ERROR(output->Write(frame_index, request, response));
  }
  return client::WritePlanes(flags.planes.files, response);
}

// The camera of the first frame.
struct FirstCamera {
  v1::Camera camera;
  std::optional<v1::CameraFit> fit;
  bool is_servers_choice = false;  // the server places it, and `camera` is not sent
};

absl::StatusOr<FirstCamera> FirstCameraOf(const RenderFlags& flags, const Subject& subject) {
  FirstCamera first{.camera = {}, .fit = flags.view.fit};
  if (!flags.shows_first_look()) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        first.camera, client::ResolveView(flags.view, flags.request.camera, subject.dataset));
    return first;
  }
  ISOSCOPE_ASSIGN_OR_RETURN(first.camera, client::FirstLookCamera(subject.dataset));
  // What fits the first frame of a film may not fit the others.
  if (subject.fits_cells && !flags.sweep.is_film()) {
    first.fit = v1::CAMERA_FIT_CELLS;
    first.is_servers_choice = true;
  }
  return first;
}

// Returns the request of the first frame.
absl::StatusOr<v1::RenderIsosurfaceRequest> MakeFirstRequest(const RenderFlags& flags,
                                                             const Subject& subject,
                                                             const FirstCamera& first) {
  ISOSCOPE_ASSIGN_OR_RETURN(
      v1::RenderIsosurfaceRequest request,
      client::MakeRequest(flags.request, subject.dataset.name(), first.camera, first.fit));
  if (first.is_servers_choice) {
    request.clear_camera();
  }
  client::SetEffects(flags.effects, &request);
  client::AddLook(flags.look, &request);
  client::SetLevel(flags.level, &request);
  if (subject.has_color_ranges) {
    client::AddCommonCapWindow(flags.look, &request);
  }
  request.set_allow_partial(flags.allow_partial);
  request.set_dataset_id(flags.dataset_id.value_or(""));
  request.set_with_notes(subject.has_notes);
  // Only statistics show it, and counting reads what the picture need not.
  request.set_with_unresolved_count(subject.has_unresolved && flags.stats.has_value() &&
                                    !flags.has_no_measures);
  if (flags.is_jpeg() || flags.planes.files.any_plane()) {
    *request.mutable_output() = MakeOutputOptions(flags.planes, flags.output);
  }
  ISOSCOPE_RETURN_IF_ERROR(client::SetFrame(flags.sweep, /*i=*/0, &request));
  return request;
}

// Describes the picture: its file, its size, the number of frames of an animation, and the level of
// the last one.
std::string DescribeResult(const RenderFlags& flags, const v1::RenderIsosurfaceResponse& last) {
  const int frame_count = flags.sweep.frame_count();
  const std::string name = flags.is_to_stdout() ? "standard output"
                           : flags.output       ? FrameFileName(*flags.output, frame_count - 1)
                           : flags.planes.files.any_plane() ? "planes"
                                                            : "picture";
  return absl::StrCat(
      name, ": ", flags.request.image_size().width_px, " x ", flags.request.image_size().height_px,
      " pixels", client::IsAnimationName(name) ? absl::StrCat(", ", frame_count, " frames") : "",
      last.has_drawn_level() ? absl::StrCat(", ", client::TextOfLevel(last.drawn_level())) : "");
}

// Draws all frames and writes their pictures. Returns the last answer.
absl::StatusOr<v1::RenderIsosurfaceResponse> DrawFrames(
    const RenderFlags& flags, const Subject& subject, const FirstCamera& camera, Session* session,
    std::vector<FrameRecord>* frames, PictureOutput* output, const Context& context) {
  const int frame_count = flags.sweep.frame_count();
  ISOSCOPE_ASSIGN_OR_RETURN(const v1::RenderIsosurfaceRequest first,
                            MakeFirstRequest(flags, subject, camera));
  v1::RenderIsosurfaceResponse last;
  v1::RenderIsosurfaceResponse ranges;  // the first answer, without pictures
  FrameProgress progress(frame_count, context.err, context.err_is_terminal);
  for (int i = 0; i < frame_count; ++i) {
    v1::RenderIsosurfaceRequest request = first;
    ISOSCOPE_RETURN_IF_ERROR(client::SetFrame(flags.sweep, i, &request));
    client::KeepRanges(ranges, &request);
    ISOSCOPE_ASSIGN_OR_RETURN(last, RenderFrame(request, flags.trace, session, frames,
                                                /*says_waiting=*/frame_count == 1, context));
    if (i == 0) {
      *ranges.mutable_colorings() = last.colorings();
      *ranges.mutable_caps_coloring() = last.caps_coloring();
    }
    if (i == 0 && flags.view.save_camera_file) {
      ISOSCOPE_RETURN_IF_ERROR(io::WriteFileAtomically(*flags.view.save_camera_file,
                                                       client::CameraToJson(last.camera())));
    }
    ISOSCOPE_RETURN_IF_ERROR(WriteFrame(flags, i, request, last, output));
    progress.Update(i + 1);
  }
  ISOSCOPE_RETURN_IF_ERROR(output->Finish());
  return last;
}

absl::Status RunFrames(const RenderFlags& given, const PictureDisplay& display, Session* session,
                       const Context& context) {
  ISOSCOPE_ASSIGN_OR_RETURN(const Subject subject, FindSubject(session));
  const v1::Dataset& dataset = subject.dataset;
  ISOSCOPE_RETURN_IF_ERROR(client::CheckColorFields(given.look, dataset));
  RenderFlags flags = given;
  session->AdaptSelection(&flags.request.selection);
  ISOSCOPE_RETURN_IF_ERROR(client::ResolveNames(dataset, &flags.request.selection, &flags.look));
  ISOSCOPE_RETURN_IF_ERROR(client::ResolveLabels(dataset, flags.request.selection,
                                                 session->frame_timeout(), &session->client(),
                                                 &flags.request.label));
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.request));
  ISOSCOPE_RETURN_IF_ERROR(
      CheckUsage(flags.look, flags.request.surface_count(), flags.request.has_sample_caps()));
  ISOSCOPE_RETURN_IF_ERROR(client::ResolveSteps(dataset, &flags.sweep));
  if (flags.sweep.is_step_sweep() && !flags.annotations.caption) {
    flags.annotations.caption = "{time}";
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const FirstCamera camera, FirstCameraOf(flags, subject));
  if (flags.is_poster()) {
    ISOSCOPE_ASSIGN_OR_RETURN(v1::RenderIsosurfaceRequest whole,
                              MakeFirstRequest(flags, subject, camera));
    whole.set_with_notes(false);
    ISOSCOPE_RETURN_IF_ERROR(ResolveVisibleRanges(session, &whole));
    ISOSCOPE_RETURN_IF_ERROR(RunPoster(flags, dataset, whole, display, session, context));
    return WriteNotesOf(
        whole, [](const v1::SurfaceNote&) { return true; }, session, context);
  }
  PictureOutput output = MakeOutput(flags, subject, context);
  std::vector<FrameRecord> frames;
  ISOSCOPE_ASSIGN_OR_RETURN(const v1::RenderIsosurfaceResponse last,
                            DrawFrames(flags, subject, camera, session, &frames, &output, context));
  ISOSCOPE_RETURN_IF_ERROR(ShowFrame(display, output, last, context));
  ISOSCOPE_RETURN_IF_ERROR(WriteStatistics(flags, dataset, session, &frames, context));
  WriteNotes(frames, context);
  WarnIfTruncated(frames, flags, context);
  WarnIfPartial(frames, context);
  if (flags.stats) {
    TextOut(flags, context) << DescribeStatistics(frames, context.out_columns) << "\n";
  }
  TextOut(flags, context) << DescribeResult(flags, last) << "\n";
  return absl::OkStatus();
}

// Repeats a picture from its record and reports how the two compare.
absl::Status RunLike(const RenderFlags& flags, const client::RecordedPng& recorded,
                     const PictureDisplay& display, Session* session, const Context& context) {
  ISOSCOPE_ASSIGN_OR_RETURN(const Subject subject, FindSubject(session));
  ISOSCOPE_RETURN_IF_ERROR(client::CheckSameSamples(recorded.record, subject.dataset));
  v1::RenderIsosurfaceRequest request = recorded.record.request;
  request.set_dataset(subject.dataset.name());
  request.set_culling(wire::ToProto(flags.request.culling.value_or(frame::Culling::kDepth)));
  request.set_with_notes(subject.has_notes);
  std::vector<FrameRecord> frames;
  ISOSCOPE_ASSIGN_OR_RETURN(const v1::RenderIsosurfaceResponse response,
                            RenderFrame(request, flags.trace, session, &frames,
                                        /*says_waiting=*/true, context));
  PictureOutput output = MakeOutput(flags, subject, context);
  ISOSCOPE_RETURN_IF_ERROR(output.Write(0, request, response));
  ISOSCOPE_RETURN_IF_ERROR(output.Finish());
  ISOSCOPE_RETURN_IF_ERROR(ShowFrame(display, output, response, context));
  ISOSCOPE_RETURN_IF_ERROR(WriteStatistics(flags, subject.dataset, session, &frames, context));
  WriteNotes(frames, context);
  ISOSCOPE_ASSIGN_OR_RETURN(const client::PictureComparison comparison,
                            client::ComparePictures(recorded, response.png()));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::string text,
      client::DescribeComparison(comparison, *flags.like, recorded.record.picture_revision,
                                 subject.picture_revision));
  TextOut(flags, context) << (flags.is_to_stdout() ? "standard output"
                                                   : FrameFileName(*flags.output, 0))
                          << ": " << base::Printable(text) << "\n";
  return absl::OkStatus();
}

WantedVolumes WantedOf(const RenderFlags& flags) {
  WantedVolumes wanted{.selection = flags.request.selection};
  if (flags.sweep.is_step_sweep()) {
    wanted.steps = [range = *flags.sweep.step_range](int step_count) {
      std::vector<int> all(static_cast<std::size_t>(step_count));
      std::iota(all.begin(), all.end(), 0);
      return client::StepsOf(range, all, "the source");
    };
  }
  AddColors(flags.look, flags.request.caps, &wanted);
  return wanted;
}

// Returns the volumes that the record of a picture needs.
WantedVolumes WantedOf(const v1::RenderIsosurfaceRequest& request) {
  WantedVolumes wanted;
  const v1::FieldSelection& selection = request.selection();
  if (!selection.field().empty()) {
    wanted.selection.field = client::FieldValue{selection.field(), selection.component()};
  }
  if (selection.has_time_step()) {
    wanted.selection.step = selection.time_step();
  } else if (selection.has_time()) {
    wanted.selection.time = selection.time();
  }
  for (const v1::Surface& surface : request.surfaces()) {
    if (!surface.color_by().field().empty()) {
      wanted.colors.push_back({.text = surface.color_by().field(),
                               .needs_all_steps = !surface.color_by().has_range() ||
                                                  surface.color_by().range().source() ==
                                                      v1::ColorRange::SOURCE_VISIBLE});
    }
  }
  return wanted;
}

// Says that a small memory limit has fewer threads draw.
void NoteFewerThreads(const RenderFlags& flags, const Context& context) {
  if (flags.is_quiet || flags.session.server) {
    return;
  }
  EmbeddedClusterOptions options;
  options.thread_count = static_cast<int>(flags.session.thread_count.value_or(0));
  options.memory_limit_bytes =
      static_cast<std::size_t>(flags.session.memory_limit_bytes.value_or(0));
  if (const std::string note = DescribeFewerThreads(options); !note.empty()) {
    *context.err << "isoscope: " << note << std::endl;
  }
}

absl::Status Run(const RenderFlags& given, const FlagSet& set, const Context& context) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(given, set, context));
  RenderFlags flags = given;
  FillFirstLook(&flags);
  ISOSCOPE_RETURN_IF_ERROR(CheckOutputs(flags));
  const PictureDisplay display = PictureDisplay::ForStandardOutput(flags.show_mode(), context);
  if (!flags.output && !flags.planes.files.any_plane() && !display.is_on()) {
    return UsageError("--output FILE.png is missing: this terminal shows no pictures");
  }
  SessionFlags session_flags = flags.session;
  session_flags.expected_layers = flags.drawn_layers();
  session_flags.draws_once = flags.sweep.frame_count() == 1 && !flags.sweep.is_step_sweep();
  if (flags.like) {
    // Read before anything is written: the output may be the same file.
    ISOSCOPE_ASSIGN_OR_RETURN(const client::RecordedPng recorded,
                              client::ReadRecordedPng(*flags.like));
    ISOSCOPE_ASSIGN_OR_RETURN(const frame::FrameSpec spec,
                              wire::FrameSpecFromProto(recorded.record.request));
    session_flags.expected_layers = frame::HasLayers(spec) ? spec.max_layers : 0;
    const WantedVolumes wanted = WantedOf(recorded.record.request);
    ISOSCOPE_ASSIGN_OR_RETURN(
        const std::unique_ptr<Session> session,
        Session::Open(session_flags, &wanted, frame::DrawnWindowOf(spec).image_size(), context));
    NoteFewerThreads(flags, context);
    return session->Finish(RunLike(flags, recorded, display, session.get(), context));
  }
  const WantedVolumes wanted = WantedOf(flags);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<Session> session,
                            Session::Open(session_flags, &wanted, flags.drawn_size(), context));
  NoteFewerThreads(flags, context);
  return session->Finish(RunFrames(flags, display, session.get(), context));
}

Action RegisterRenderFlags(FlagSet* set) {
  const auto flags = std::make_shared<RenderFlags>();
  AddRenderFlags(set, flags.get());
  return [flags, set](const Context& context) {
    return Run(*flags, *set, flags->is_quiet ? WithoutProgress(context) : context);
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
              "  isoscope render --server localhost:50051 --isovalue 60 --repeat 36 \\\n"
              "    --orbit 10 --output turn-%03d.png --stats turn.json\n"
              "  isoscope render head.nii.gz --isovalue 20:120:5 --output isovalues.webp\n"
              "  isoscope render head.nii.gz --isovalue 60 --width 32768 --height 32768 \\\n"
              "    --renderer cpu --output poster.png\n"
              "  isoscope render head.nii.gz --isovalue 60 --output head.jpg --depth depth.npy\n"
              "  isoscope render head.nii.gz --isovalue 60 --light -1,1,2 \\\n"
              "    --color-by z:turbo --legend --output height.png\n"
              "  isoscope render head.nii.gz --like head.png --output again.png\n"
              "  isoscope render head.nii.gz --isovalue 60 --output - | display\n",
          .register_flags = RegisterRenderFlags};
}

}  // namespace isoscope::cli
