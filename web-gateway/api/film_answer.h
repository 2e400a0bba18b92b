// The film of an answer, from the coordinator's pictures to a temporary file.

#ifndef ISOSCOPE_WEB_GATEWAY_API_FILM_ANSWER_H_
#define ISOSCOPE_WEB_GATEWAY_API_FILM_ANSWER_H_

#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "clients/cpp/picture_file/animation_writer.h"
#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "web-gateway/api/mesh_budget.h"
#include "web-gateway/api/render_query.h"
#include "web-gateway/http/http_message.h"

namespace isoscope::gateway {

// Limits of one film. libwebp holds all encoded frames in memory until the end.
inline constexpr int kMaxFilmFrames = 720;
inline constexpr std::int64_t kMaxFilmPixels = std::int64_t{1} << 29;  // of all frames

// "image/webp" or "image/apng".
std::string FilmMediaType(client::AnimationFormat format);

// INVALID_ARGUMENT if the film has more frames or pixels than the limits, more pixels a frame than
// kMaxDecodedPixels, a side that the format can't have, or a legend of nothing.
absl::Status CheckFilm(client::AnimationFormat format, const FilmQuery& film);

// Thread-compatible.
class FilmAnswer {
 public:
  // Takes a place of `caller` in the budget, which outlives the answer, and creates the file.
  // `max_disk_bytes`: what this film may take. REQUIRES: CheckFilm is OK.
  static absl::StatusOr<std::unique_ptr<FilmAnswer>> Begin(
      client::AnimationFormat format, FilmQuery film, isoscope::v1::Dataset dataset,
      const std::string& caller, std::int64_t max_disk_bytes, MeshBudget* budget);
  // Removes the file, unless Finish has returned it.
  ~FilmAnswer();
  FilmAnswer(const FilmAnswer&) = delete;
  FilmAnswer& operator=(const FilmAnswer&) = delete;

  // Returns the request of the next frame. Its colour maps keep the ranges of the first.
  // INVALID_ARGUMENT if the camera is wrong. REQUIRES: !is_complete().
  [[nodiscard]] absl::StatusOr<isoscope::v1::RenderIsosurfaceRequest> NextRequest() const;
  // Draws annotations over the answer to `request`, that of NextRequest, and adds it. Takes the time
  // of encoding. RESOURCE_EXHAUSTED if the film is too large; else errors as AddExtras.
  absl::Status Add(const isoscope::v1::RenderIsosurfaceRequest& request,
                   isoscope::v1::RenderIsosurfaceResponse response);
  [[nodiscard]] bool is_complete() const { return frame_count_ == film_.sweep.frame_count(); }
  // Returns the answer, which holds the place in the budget. No call follows. REQUIRES:
  // is_complete().
  absl::StatusOr<HttpResponse> Finish();

  // Returns the answer without a film.
  [[nodiscard]] HttpResponse Header() const;

 private:
  FilmAnswer(client::AnimationFormat format, FilmQuery film, isoscope::v1::Dataset dataset,
             std::int64_t max_disk_bytes, std::shared_ptr<MeshBudget::Lease> lease)
      : format_(format),
        film_(std::move(film)),
        dataset_(std::move(dataset)),
        max_disk_bytes_(max_disk_bytes),
        lease_(std::move(lease)) {}
  // Counts the pictures as what the film takes, on disk or in memory.
  absl::Status CountBytes(std::int64_t more);

  const client::AnimationFormat format_;
  const FilmQuery film_;
  const isoscope::v1::Dataset dataset_;
  const std::int64_t max_disk_bytes_;
  std::shared_ptr<MeshBudget::Lease> lease_;
  std::string path_;  // empty: there is no file, or it is the answer's
  std::unique_ptr<client::AnimationWriter> writer_;
  isoscope::v1::RenderIsosurfaceResponse ranges_;  // of the first frame, without its picture
  int frame_count_ = 0;
  std::int64_t bytes_ = 0;
};

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_API_FILM_ANSWER_H_
