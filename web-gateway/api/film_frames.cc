#include "web-gateway/api/film_frames.h"

#include <optional>
#include <utility>

#include "absl/status/status.h"
#include "absl/time/time.h"

#include "core/base/monotonic_time.h"
#include "core/base/retry_delay.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::gateway {
namespace {

namespace v1 = isoscope::v1;

// Whoever waits for an answer holds it. Only one thread uses it at a time.
class FilmFrames : public std::enable_shared_from_this<FilmFrames> {
 public:
  using Done = std::function<void(absl::StatusOr<HttpResponse>)>;

  FilmFrames(std::unique_ptr<FilmAnswer> film, FilmFramesOptions options, Done done)
      : options_(std::move(options)), film_(std::move(film)), done_(std::move(done)) {}

  void DrawNext() {
    absl::StatusOr<v1::RenderIsosurfaceRequest> request = film_->NextRequest();
    if (!request.ok()) {
      End(request.status());
      return;
    }
    request_ = *std::move(request);
    last_try_ = base::MonotonicNow() + options_.client->max_duration();
    Draw();
  }

 private:
  void Draw() {
    options_.client->Render(
        request_, options_.call,
        [self = shared_from_this()](absl::StatusOr<v1::RenderIsosurfaceResponse> rendered) {
          self->Take(std::move(rendered));
        });
  }

  void Take(absl::StatusOr<v1::RenderIsosurfaceResponse> rendered) {
    const absl::Status status = rendered.ok() ? options_.call.scope->Check() : rendered.status();
    if (!status.ok()) {
      RetryOrEnd(status);
      return;
    }
    if (options_.is_head) {
      HttpResponse header = film_->Header();
      header.has_unknown_length = true;
      End(std::move(header));
      return;
    }
    const bool is_queued = options_.drawing->TrySchedule(
        [self = shared_from_this(), frame = *std::move(rendered)]() mutable {
          self->Add(std::move(frame));
        });
    if (!is_queued) {
      End(base::WithRetryDelay(absl::ResourceExhaustedError("too many pictures wait to be added to "
                                                            "their films"),
                               absl::Seconds(1)));
    }
  }

  // Asks for the same frame when its refusal says so: the frames before it are not lost.
  void RetryOrEnd(const absl::Status& refusal) {
    const std::optional<absl::Duration> delay = base::RetryDelayOf(refusal);
    if (!delay.has_value() || base::MonotonicNow() + *delay >= last_try_) {
      End(refusal);
      return;
    }
    options_.client->Wait(*delay, options_.call,
                          [self = shared_from_this()](const absl::Status& waited) {
                            if (waited.ok()) {
                              self->Draw();
                            } else {
                              self->End(waited);
                            }
                          });
  }

  void Add(v1::RenderIsosurfaceResponse frame) {
    absl::Status status = options_.call.scope->Check();  // a client that left waits for none
    if (status.ok()) {
      status = film_->Add(request_, std::move(frame));
    }
    if (status.ok()) {
      status = options_.call.scope->Check();
    }
    if (!status.ok()) {
      End(status);
    } else if (film_->is_complete()) {
      End(film_->Finish());
    } else {
      DrawNext();
    }
  }

  void End(absl::StatusOr<HttpResponse> response) {
    film_.reset();
    std::exchange(done_, nullptr)(std::move(response));
  }

  const FilmFramesOptions options_;
  std::unique_ptr<FilmAnswer> film_;
  Done done_;
  v1::RenderIsosurfaceRequest request_;  // of the frame in work
  base::MonotonicTime last_try_;         // of that frame
};

}  // namespace

void DrawFilm(std::unique_ptr<FilmAnswer> film, FilmFramesOptions options,
              std::function<void(absl::StatusOr<HttpResponse>)> done) {
  std::make_shared<FilmFrames>(std::move(film), std::move(options), std::move(done))->DrawNext();
}

}  // namespace isoscope::gateway
