// Two threads. One reads frames from the Interact stream and keeps the newest. The other, which
// called Run, reads keys, sends views, and draws. A frame is acknowledged once it is drawn, or
// replaced by a newer one. So the server sends no more than the terminal can draw.
//
//   keys ──▶ ViewControls ──▶ Interact ──▶ FrameFeed ──▶ DrawFrame ──▶ terminal
//
// One event wakes the loop for everything but keys: a frame, a signal, Ctrl-C, the end.

#include "client-cli/terminal/terminal_viewer.h"

#include <fcntl.h>
#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include <nlohmann/json.hpp>

#include "client-cli/terminal/raw_terminal.h"
#include "client-cli/terminal/terminal_keys.h"
#include "client-cli/terminal/terminal_picture.h"
#include "client-cli/terminal/view_controls.h"
#include "client-cli/terminal/view_labels.h"
#include "client-cli/terminal/viewer_layout.h"
#include "clients/cpp/connection/features.h"
#include "clients/cpp/connection/service_client.h"
#include "core/base/cancellation.h"
#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/cli/table.h"
#include "isoscope/v1/interact_service.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "wire/first_look.h"
#include "wire/proto_convert.h"

namespace isoscope::cli {
namespace {

namespace v1 = isoscope::v1;

// The alternate screen without a cursor; and back.
constexpr char kEnterScreen[] = "\x1B[?1049h\x1B[?25l\x1B[2J";
constexpr char kLeaveScreen[] = "\x1B[0m\x1B[?25h\x1B[?1049l";
// Removes all visible pictures of kitty.
constexpr char kRemoveAll[] = "\x1B_Ga=d,d=A,q=2\x1B\\";
constexpr char kBeginUpdate[] = "\x1B[?2026h";
constexpr char kEndUpdate[] = "\x1B[?2026l";
// Terminals draw more slowly than screens.
constexpr double kFramesPerSecond = 20;
// More states than can be under way at a time.
constexpr std::size_t kMaxStates = 256;

// Returns the shortest decimal that is read as the same bits.
std::string Exact(double value) { return nlohmann::json(value + 0.0).dump(); }

std::string Exact(const v1::Vec3& v) {
  return absl::StrCat(Exact(v.x()), ",", Exact(v.y()), ",", Exact(v.z()));
}

// The newest frame of a stream, read by its own thread.
class FrameFeed {
 public:
  // `stream` must outlive it.
  explicit FrameFeed(client::InteractStream* stream)
      : stream_(stream), reader_([this] { Read(); }) {}
  ~FrameFeed() {
    // Cancelling a stream that has ended would replace its error.
    if (!has_ended()) {
      stream_->Cancel();
    }
    reader_.join();
  }
  FrameFeed(const FrameFeed&) = delete;
  FrameFeed& operator=(const FrameFeed&) = delete;

  // Returns the newest frame that was not taken yet.
  std::optional<v1::InteractResponse> Take() ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    return std::exchange(newest_, std::nullopt);
  }
  bool has_ended() ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    return has_ended_;
  }

  // Acknowledges a frame that was shown, or dropped. If the stream has ended, the reader reports
  // it.
  void Acknowledge(std::int64_t frame_number, absl::Duration duration) {
    v1::InteractRequest shown;
    shown.mutable_frame_shown()->set_frame_number(frame_number);
    *shown.mutable_frame_shown()->mutable_decode_duration() = wire::ToProto(duration);
    stream_->Write(shown);
  }

 private:
  void Read() ABSL_LOCKS_EXCLUDED(mutex_) {
    v1::InteractResponse response;
    while (stream_->Read(&response)) {
      std::optional<v1::InteractResponse> dropped;
      {
        const base::MutexLock lock(&mutex_);
        dropped = std::exchange(newest_, std::move(response));
      }
      if (dropped) {
        Acknowledge(dropped->frame_number(), absl::ZeroDuration());
      }
      response.Clear();
      TerminalSignals::Wake();
    }
    const base::MutexLock lock(&mutex_);
    has_ended_ = true;
    TerminalSignals::Wake();
  }

  client::InteractStream* const stream_;
  base::Mutex mutex_;
  std::optional<v1::InteractResponse> newest_ ABSL_GUARDED_BY(mutex_);
  bool has_ended_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread reader_;  // comes last: it uses the other members
};

// The terminal of this process, closed at the end.
class Tty {
 public:
  Tty() : fd_(open("/dev/tty", O_RDWR | O_NOCTTY | O_CLOEXEC)) {}
  ~Tty() {
    if (fd_ >= 0) {
      close(fd_);
    }
  }
  Tty(const Tty&) = delete;
  Tty& operator=(const Tty&) = delete;
  [[nodiscard]] int fd() const { return fd_; }

 private:
  const int fd_;
};

// The notes of a frame, with semicolons between.
std::string NotesOf(const v1::RenderIsosurfaceResponse& frame) {
  return absl::StrJoin(frame.notes(), "; ", [](std::string* out, const v1::SurfaceNote& note) {
    absl::StrAppend(out, note.message());
  });
}

// " --level 2", or "" if the frame has no choice.
std::string FlagOfLevel(const v1::LevelChoice& choice) {
  switch (choice.choice_case()) {
    case v1::LevelChoice::kLevel:
      return absl::StrCat(" --level ", choice.level());
    case v1::LevelChoice::kMaxSpacingPx:
      return absl::StrCat(" --max-spacing ", Exact(choice.max_spacing_px()));
    case v1::LevelChoice::CHOICE_NOT_SET:
      break;
  }
  return "";
}

// What a server knows beyond its first version.
struct Abilities {
  bool has_notes = false;   // it tells why surfaces do not show
  bool fits_cells = false;  // it knows CAMERA_FIT_CELLS
};

class Viewer {
 public:
  // abilities: of the server
  Viewer(const v1::Dataset& dataset, const ViewedVolume& volume, const ViewedSurfaces& surfaces,
         const Abilities& abilities, int tty, const PictureTerminal& terminal,
         client::InteractStream* stream)
      : dataset_name_(dataset.name()),
        abilities_(abilities),
        camera_from_(abilities.fits_cells ? std::optional<std::int64_t>(0) : std::nullopt),
        tty_(tty),
        stream_(stream),
        labels_(surfaces.labels),
        level_(surfaces.level),
        controls_(volume, surfaces.isovalue, surfaces.labels.size()),
        layout_(LayoutOf(terminal.format, terminal.size)),
        cell_(CellOf(terminal.size)) {}

  // Runs until the user, `cancellation` or the server ends it.
  absl::Status Run(const base::Cancellation& cancellation);
  // The surfaces of the newest view, and its request.
  [[nodiscard]] ViewedSurfaces Surfaces() const;
  [[nodiscard]] v1::RenderIsosurfaceRequest Frame() const;
  // Returns true if Run returned because the server ended the stream.
  [[nodiscard]] bool was_ended_by_server() const { return was_ended_by_server_; }

 private:
  absl::Status Handle(TerminalSignals::Pending pending);
  absl::Status HandleKeys(absl::string_view bytes);
  absl::Status SendView(bool is_at_rest);
  absl::Status Draw(FrameFeed* feed);
  absl::Status DrawLast();
  absl::Status DrawHelp();
  // Gives the controls the camera of an answer if the server has placed it.
  absl::Status TakeCamera(const v1::InteractResponse& answer);
  [[nodiscard]] std::string DescribeSurfaces() const;
  [[nodiscard]] std::string StatusLine() const;
  [[nodiscard]] std::string Clear() const {
    return absl::StrCat(layout_.format == PictureFormat::kKitty ? kRemoveAll : "", "\x1B[2J");
  }

  const std::string dataset_name_;
  const Abilities abilities_;
  // The server places the camera, and the answer to this state or a newer one has it; not set: the
  // controls have the camera.
  std::optional<std::int64_t> camera_from_;
  const int tty_;
  client::InteractStream* const stream_;
  const std::vector<client::LabelSurface> labels_;
  const client::LevelFlags level_;
  ViewControls controls_;
  ViewerLayout layout_;
  const view::Viewport cell_;
  KeyReader keys_;
  std::unique_ptr<RawTerminal> raw_;
  std::int64_t sequence_number_ = 0;
  SentStates sent_;
  std::optional<v1::InteractResponse> last_;
  std::optional<absl::Duration> latency_;  // of last_
  std::string message_;                    // error of the last frame, or its notes
  int image_number_ = 1;
  bool shows_help_ = false;
  bool is_done_ = false;
  bool was_ended_by_server_ = false;
};

ViewedSurfaces Viewer::Surfaces() const {
  return {.isovalue = controls_.isovalue(),
          .labels = ShownLabels(labels_, controls_.labels()),
          .level = level_};
}

v1::RenderIsosurfaceRequest Viewer::Frame() const {
  v1::RenderIsosurfaceRequest frame;
  frame.set_dataset(dataset_name_);
  const ViewedSurfaces shown = Surfaces();
  if (shown.isovalue) {
    frame.add_surfaces()->set_isovalue(*shown.isovalue);
  }
  for (const client::LabelSurface& label : shown.labels) {
    client::AddTo(label, frame.add_surfaces());
  }
  wire::AddFirstMaterial(&frame);
  frame.set_samples(wire::GetFirstLook().samples());
  if (camera_from_) {
    frame.set_camera_fit(v1::CAMERA_FIT_CELLS);
  } else {
    *frame.mutable_camera() = wire::ToProto(controls_.camera());
  }
  frame.mutable_viewport()->set_width_px(layout_.viewport.width_px);
  frame.mutable_viewport()->set_height_px(layout_.viewport.height_px);
  frame.set_culling(v1::CULLING_DEPTH);
  client::SetLevel(level_, &frame);
  frame.set_with_notes(abilities_.has_notes);
  return frame;
}

absl::Status Viewer::SendView(bool is_at_rest) {
  v1::InteractRequest request;
  v1::ViewState& state = *request.mutable_view_state();
  state.set_sequence_number(++sequence_number_);
  *state.mutable_frame() = Frame();
  state.set_target_frames_per_second(kFramesPerSecond);
  state.set_is_at_rest(is_at_rest);
  sent_.Add(sequence_number_, base::MonotonicNow());
  stream_->Write(request);  // if the stream has ended, the reader reports it
  return absl::OkStatus();
}

std::string Viewer::DescribeSurfaces() const {
  std::vector<std::string> parts;
  if (controls_.isovalue()) {
    parts.push_back(absl::StrFormat("isovalue %.6g", *controls_.isovalue()));
  }
  if (!labels_.empty()) {
    parts.push_back(DescribeLabels(labels_, controls_.labels()));
  }
  return absl::StrJoin(parts, ", ");
}

std::string Viewer::StatusLine() const {
  std::string figures;
  if (last_) {
    const v1::RenderIsosurfaceResponse& frame = last_->frame();
    absl::StrAppend(&figures, frame.extent().width_px(), " x ", frame.extent().height_px(),
                    frame.drawn_level().level() > 0
                        ? absl::StrCat(" ", client::TextOfLevel(frame.drawn_level()))
                    : last_->is_exact() ? " exact"
                                        : "");
    if (latency_) {
      absl::StrAppendFormat(&figures, "   %.0f ms", absl::ToDoubleMilliseconds(*latency_));
    }
  }
  const std::string text = StatusText(absl::StrCat(dataset_name_, "   ", DescribeSurfaces()),
                                      message_, figures, layout_.terminal.columns);
  return absl::StrCat("\x1B[", layout_.terminal.rows, ";1H\x1B[0;7m", text, "\x1B[0m");
}

absl::Status Viewer::DrawLast() {
  std::string bytes = kBeginUpdate;
  if (last_ && last_->has_frame()) {
    const int number = 3 - image_number_;
    ISOSCOPE_ASSIGN_OR_RETURN(const std::string picture, DrawFrame(layout_, *last_, number));
    absl::StrAppend(&bytes, "\x1B[H", picture);
    if (layout_.format == PictureFormat::kKitty) {
      absl::StrAppend(&bytes, KittyRemoval(image_number_));
      image_number_ = number;
    }
  }
  absl::StrAppend(&bytes, StatusLine(), kEndUpdate);
  return WriteToTerminal(tty_, bytes);
}

absl::Status Viewer::Draw(FrameFeed* feed) {
  std::optional<v1::InteractResponse> newest = feed->Take();
  if (!newest) {
    return absl::OkStatus();
  }
  const base::MonotonicTime start = base::MonotonicNow();
  const std::int64_t frame_number = newest->frame_number();
  message_ = newest->has_error() ? newest->error().message() : NotesOf(newest->frame());
  if (newest->has_frame()) {
    latency_ = sent_.TakeLatency(newest->sequence_number(), start);
    ISOSCOPE_RETURN_IF_ERROR(TakeCamera(*newest));
    last_ = std::move(newest);
  }
  const absl::Status drawn = shows_help_ ? absl::OkStatus() : DrawLast();
  feed->Acknowledge(frame_number, base::MonotonicNow() - start);
  return drawn;
}

absl::Status Viewer::TakeCamera(const v1::InteractResponse& answer) {
  if (camera_from_ && answer.sequence_number() >= *camera_from_) {
    ISOSCOPE_ASSIGN_OR_RETURN(const view::Camera camera,
                              wire::CameraFromProto(answer.frame().camera(), "frame.camera"));
    controls_.SetCamera(camera);
    camera_from_.reset();
  }
  return absl::OkStatus();
}

absl::Status Viewer::DrawHelp() {
  std::string text = absl::StrCat(kBeginUpdate, Clear(), "\x1B[H\r\n  ");
  absl::StrAppend(&text, absl::StrReplaceAll(DescribeKeys(), {{"\n", "\r\n  "}}));
  if (!message_.empty()) {
    // The whole of what the last row may have cut.
    const auto width = static_cast<std::size_t>(std::max(1, layout_.terminal.columns - 4));
    absl::StrAppend(&text, "\r\n  ",
                    absl::StrJoin(WrapText(base::Printable(message_), width), "\r\n  "));
  }
  return WriteToTerminal(tty_, absl::StrCat(text, StatusLine(), kEndUpdate));
}

absl::Status Viewer::HandleKeys(absl::string_view bytes) {
  bool has_moved = false;
  for (const Key& key : keys_.Take(bytes)) {
    if (shows_help_) {
      shows_help_ = false;
      ISOSCOPE_RETURN_IF_ERROR(WriteToTerminal(tty_, Clear()));
      ISOSCOPE_RETURN_IF_ERROR(DrawLast());
      if (key.character == '?') {
        continue;
      }
    }
    switch (controls_.Press(key)) {
      case ViewControls::Effect::kNone:
        break;
      case ViewControls::Effect::kMoved:
        has_moved = true;
        camera_from_.reset();
        break;
      case ViewControls::Effect::kReset:
        has_moved = true;
        camera_from_ = abilities_.fits_cells ? std::optional(sequence_number_ + 1) : std::nullopt;
        break;
      case ViewControls::Effect::kHelp:
        shows_help_ = true;
        break;
      case ViewControls::Effect::kQuit:
        is_done_ = true;
        return absl::OkStatus();
    }
  }
  if (has_moved) {
    ISOSCOPE_RETURN_IF_ERROR(SendView(/*is_at_rest=*/false));
  }
  return shows_help_ ? DrawHelp() : absl::OkStatus();
}

absl::Status Viewer::Handle(TerminalSignals::Pending pending) {
  if (pending.is_suspended) {
    ISOSCOPE_RETURN_IF_ERROR(raw_->Suspend());
  }
  if (!pending.is_suspended && !pending.is_resized) {
    return absl::OkStatus();
  }
  // The window may have changed while the process was stopped.
  if (std::optional<TerminalSize> size = SizeOfTerminal(tty_)) {
    if (size->pixels.width_px == 0) {
      size->pixels = {.width_px = cell_.width_px * size->columns,
                      .height_px = cell_.height_px * size->rows};
    }
    layout_ = LayoutOf(layout_.format, *size);
  }
  ISOSCOPE_RETURN_IF_ERROR(WriteToTerminal(tty_, Clear()));
  ISOSCOPE_RETURN_IF_ERROR(shows_help_ ? DrawHelp() : DrawLast());
  return SendView(/*is_at_rest=*/true);
}

absl::Status Viewer::Run(const base::Cancellation& cancellation) {
  const TerminalSignals signals;
  const base::Cancellation::Callback on_interrupt(cancellation, [] { TerminalSignals::Wake(); });
  FrameFeed feed(stream_);
  const std::string leave =
      absl::StrCat(layout_.format == PictureFormat::kKitty ? kRemoveAll : "", kLeaveScreen);
  ISOSCOPE_ASSIGN_OR_RETURN(raw_, RawTerminal::Enter(tty_, kEnterScreen, leave));
  ISOSCOPE_RETURN_IF_ERROR(DrawLast());
  ISOSCOPE_RETURN_IF_ERROR(SendView(/*is_at_rest=*/true));
  while (!is_done_ && !cancellation.is_cancelled() && !feed.has_ended()) {
    std::array<pollfd, 2> waiting = {
        pollfd{.fd = tty_, .events = POLLIN, .revents = 0},
        pollfd{.fd = TerminalSignals::wake_fd(), .events = POLLIN, .revents = 0}};
    if (poll(waiting.data(), waiting.size(), -1) < 0 && errno != EINTR) {
      return absl::InternalError("the terminal can't be waited for");
    }
    if (waiting[0].revents != 0) {
      ISOSCOPE_ASSIGN_OR_RETURN(const std::string bytes,
                                ReadFromTerminal(tty_, absl::ZeroDuration()));
      ISOSCOPE_RETURN_IF_ERROR(HandleKeys(bytes));
    }
    ISOSCOPE_RETURN_IF_ERROR(Handle(TerminalSignals::Take()));
    ISOSCOPE_RETURN_IF_ERROR(Draw(&feed));
  }
  was_ended_by_server_ = !is_done_ && !cancellation.is_cancelled();
  camera_from_.reset();  // the last view is that of the controls, also before the first answer
  raw_.reset();
  return absl::OkStatus();
}

}  // namespace

void SentStates::Add(std::int64_t sequence_number, base::MonotonicTime sent) {
  sent_[sequence_number] = sent;
  if (sent_.size() > kMaxStates) {
    sent_.erase(sent_.begin());
  }
}

std::optional<absl::Duration> SentStates::TakeLatency(std::int64_t sequence_number,
                                                      base::MonotonicTime now) {
  sent_.erase(sent_.begin(), sent_.lower_bound(sequence_number));
  const auto found = sent_.find(sequence_number);
  return found == sent_.end() ? std::nullopt : std::optional(now - found->second);
}

std::string FlagsOfFrame(const v1::RenderIsosurfaceRequest& frame, const ViewedSurfaces& surfaces) {
  const v1::Camera& camera = frame.camera();
  std::vector<std::string> drawn;
  if (surfaces.isovalue) {
    drawn.push_back(absl::StrCat("--isovalue ", Exact(*surfaces.isovalue)));
  }
  if (!surfaces.labels.empty()) {
    drawn.push_back(FlagsOfLabels(surfaces.labels));
  }
  return absl::StrCat(absl::StrJoin(drawn, " "), " --eye ", Exact(camera.eye()), " --target ",
                      Exact(camera.target()), " --up ", Exact(camera.up()),
                      frame.surfaces(0).has_material() ? " --material soft" : "",
                      frame.samples() > 1 ? absl::StrCat(" --samples ", frame.samples()) : "",
                      " --width ", frame.viewport().width_px(), " --height ",
                      frame.viewport().height_px(), FlagOfLevel(frame.level()));
}

absl::Status RunTerminalViewer(const v1::Dataset& dataset, const ViewedSurfaces& surfaces,
                               ShowMode mode, Session* session, const Context& context) {
  const Tty tty;
  const std::optional<PictureTerminal> terminal =
      tty.fd() < 0
          ? std::nullopt
          : FindPictureTerminal(tty.fd(), ProcessEnvironment, FormatOf(mode, ProcessEnvironment));
  if (!terminal) {
    return absl::FailedPreconditionError(
        "there is no terminal to draw on; without --terminal the view is in the browser");
  }
  if (terminal->format == PictureFormat::kNone) {
    return absl::FailedPreconditionError(
        absl::StrCat("this terminal shows no pictures (TERM is '", ProcessEnvironment("TERM"),
                     "', NO_COLOR is '", ProcessEnvironment("NO_COLOR"),
                     "'); --show blocks draws all the same, and without --terminal the view is in "
                     "the browser"));
  }
  ViewedVolume volume;
  ISOSCOPE_ASSIGN_OR_RETURN(const volume::GridGeometry geometry,
                            wire::GeometryFromProto(dataset.geometry(), "dataset.geometry"));
  volume.bounds = geometry.Bounds();
  if (!dataset.patient_frame().empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(volume.patient_frame,
                              volume::PatientFrame::FromName(dataset.patient_frame()));
  }
  if (dataset.has_value_range()) {
    const v1::ValueRange& values =
        dataset.has_finite_range() ? dataset.finite_range() : dataset.value_range();
    volume.values = {values.min(), values.max()};
  }
  volume.first_camera = wire::FirstLookCamera(volume.bounds, volume.patient_frame);
  ISOSCOPE_ASSIGN_OR_RETURN(const client::Features features,
                            client::FeaturesOf(session->question_timeout(), &session->client()));
  const Abilities abilities{.has_notes = features.count("notes") > 0,
                            .fits_cells = features.count("fit_cells") > 0};
  const std::unique_ptr<client::InteractStream> stream = session->client().Interact();
  Viewer viewer(dataset, volume, surfaces, abilities, tty.fd(), *terminal, stream.get());
  const absl::Status status = viewer.Run(context.interrupt->cancellation());
  const absl::Status stream_status = stream->Finish();
  ISOSCOPE_RETURN_IF_ERROR(status);
  if (viewer.was_ended_by_server()) {
    return stream_status.ok() ? absl::UnavailableError("the server has ended the view")
                              : stream_status;
  }
  *context.out << "the last view, for isoscope render: "
               << FlagsOfFrame(viewer.Frame(), viewer.Surfaces()) << std::endl;
  return absl::OkStatus();
}

}  // namespace isoscope::cli
