// The frames of a film in work, one after another.

#ifndef ISOSCOPE_WEB_GATEWAY_API_FILM_FRAMES_H_
#define ISOSCOPE_WEB_GATEWAY_API_FILM_FRAMES_H_

#include <functional>
#include <memory>

#include "absl/status/statusor.h"

#include "core/base/executor.h"
#include "web-gateway/api/coordinator_client.h"
#include "web-gateway/api/film_answer.h"
#include "web-gateway/http/http_message.h"

namespace isoscope::gateway {

struct FilmFramesOptions {
  CoordinatorClient* client;
  CallOptions call;         // of each frame; its scope is set
  base::Executor* drawing;  // adds the frames
  bool is_head = false;     // the film ends with its first frame
};

// Asks the coordinator for each frame, adds it on a thread of `drawing`, and asks for the next. A
// frame that is refused with a retry delay is asked for again after it, for max_duration() of the
// client at most. Calls
// `done` once, on one of these threads or of gRPC's, after the file of a film that failed is gone.
// Once the scope is cancelled the frame in work ends, and neither client nor executor is used again.
// Both outlive the film.
void DrawFilm(std::unique_ptr<FilmAnswer> film, FilmFramesOptions options,
              std::function<void(absl::StatusOr<HttpResponse>)> done);

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_API_FILM_FRAMES_H_
