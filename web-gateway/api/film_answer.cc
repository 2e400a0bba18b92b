// The bytes that a film takes until it is complete are not known: libwebp does not tell them. The
// PNGs of its frames are counted instead. An APNG has just these, a WebP fewer.

#include "web-gateway/api/film_answer.h"

#include <algorithm>
#include <filesystem>
#include <system_error>

#include "absl/strings/str_cat.h"

#include "clients/cpp/connection/film_file.h"
#include "clients/cpp/picture_file/webp_writer.h"
#include "clients/cpp/request/look_flags.h"
#include "clients/cpp/request/sweep_flags.h"
#include "core/base/status_macros.h"
#include "web-gateway/api/answer_file.h"
#include "web-gateway/api/picture_extras.h"
#include "wire/field_selection.h"

namespace isoscope::gateway {
namespace {

namespace v1 = isoscope::v1;

constexpr char kAdvice[] = "ask for fewer or smaller frames, or use `isoscope render`";

std::string NameOfFile(client::AnimationFormat format) {
  return absl::StrCat("film.", client::NameOf(format));
}

// All frames are of one dataset, and "the last step" is one step, whatever is served meanwhile.
void Pin(const v1::Dataset& dataset, v1::RenderIsosurfaceRequest* request) {
  request->set_dataset_id(dataset.dataset_id());
  if (dataset.fields().empty()) {
    return;
  }
  const auto selection = wire::ResolveSelection(request->selection(), dataset);
  if (selection.ok()) {  // else the coordinator says what there is
    *request->mutable_selection() = *selection;
  }
}

}  // namespace

std::string FilmMediaType(client::AnimationFormat format) {
  return absl::StrCat("image/", client::NameOf(format));
}

absl::Status CheckFilm(client::AnimationFormat format, const FilmQuery& film) {
  const int count = film.sweep.frame_count();
  if (count > kMaxFilmFrames) {
    return absl::InvalidArgumentError(absl::StrCat("the film has ", count,
                                                   " frames, and the gateway's limit is ",
                                                   kMaxFilmFrames, ": ", kAdvice));
  }
  const bool is_part = film.first.has_region();
  const int width = is_part ? film.first.region().width_px() : film.first.viewport().width_px();
  const int height = is_part ? film.first.region().height_px() : film.first.viewport().height_px();
  const std::int64_t pixels = std::int64_t{width} * height;
  if (pixels > kMaxDecodedPixels || pixels * count > kMaxFilmPixels) {
    return absl::InvalidArgumentError(absl::StrCat(
        "the film has ", count, " frames of ", width, " x ", height, ", ", pixels * count,
        " pixels together, and the gateway's limit is ", kMaxFilmPixels, " of all frames and ",
        kMaxDecodedPixels, " of one: ", kAdvice));
  }
  if (format == client::AnimationFormat::kWebp &&
      std::max(width, height) > client::kMaxWebpSidePx) {
    return absl::InvalidArgumentError(
        absl::StrCat("the film has ", width, " x ", height, " pixels: a WebP has at most ",
                     client::kMaxWebpSidePx, " a side; film.apng may have more"));
  }
  return CheckExtras({.annotations = film.annotations}, film.first, /*picture_revision=*/"");
}

absl::StatusOr<std::unique_ptr<FilmAnswer>> FilmAnswer::Begin(client::AnimationFormat format,
                                                              FilmQuery film, v1::Dataset dataset,
                                                              const std::string& caller,
                                                              std::int64_t max_disk_bytes,
                                                              MeshBudget* budget) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<MeshBudget::Lease> lease, budget->Begin(caller));
  Pin(dataset, &film.first);
  std::unique_ptr<FilmAnswer> answer(new FilmAnswer(format, std::move(film), std::move(dataset),
                                                    max_disk_bytes, std::move(lease)));
  ISOSCOPE_ASSIGN_OR_RETURN(answer->path_, MakeAnswerPath(NameOfFile(format)));
  const client::SweepFlags& sweep = answer->film_.sweep;
  ISOSCOPE_ASSIGN_OR_RETURN(answer->writer_, client::CreateFilm(answer->path_, answer->film_.first,
                                                                sweep.frame_count(), sweep.fps()));
  return answer;
}

FilmAnswer::~FilmAnswer() {
  writer_.reset();  // without Finish, this removes the file
  if (!path_.empty()) {
    RemoveTemporaryFile(path_);
  }
}

absl::StatusOr<v1::RenderIsosurfaceRequest> FilmAnswer::NextRequest() const {
  v1::RenderIsosurfaceRequest request = film_.first;
  ISOSCOPE_RETURN_IF_ERROR(client::SetFrame(film_.sweep, frame_count_, &request));
  client::KeepRanges(ranges_, &request);
  return request;
}

absl::Status FilmAnswer::Add(const v1::RenderIsosurfaceRequest& request,
                             v1::RenderIsosurfaceResponse response) {
  if (frame_count_ == 0) {
    *ranges_.mutable_colorings() = response.colorings();
    *ranges_.mutable_caps_coloring() = response.caps_coloring();
  }
  ISOSCOPE_RETURN_IF_ERROR(AddExtras({.annotations = film_.annotations}, request, dataset_,
                                     /*picture_revision=*/"", &response));
  ISOSCOPE_RETURN_IF_ERROR(CountBytes(static_cast<std::int64_t>(response.png().size())));
  ISOSCOPE_RETURN_IF_ERROR(writer_->AddFrame(response.png()));
  ++frame_count_;
  return absl::OkStatus();
}

absl::Status FilmAnswer::CountBytes(std::int64_t more) {
  constexpr std::int64_t kMaxBytes = std::int64_t{1} << 30;
  bytes_ += more;
  if (bytes_ > std::min(kMaxBytes, max_disk_bytes_)) {
    return absl::ResourceExhaustedError(
        absl::StrCat("the pictures of the film have ", bytes_, " bytes at frame ", frame_count_ + 1,
                     " of ", film_.sweep.frame_count(), ", and the gateway's limit is ", kMaxBytes,
                     ", --max-mesh-bytes is ", max_disk_bytes_, ": ", kAdvice));
  }
  return lease_->SetBytes(bytes_);
}

absl::StatusOr<HttpResponse> FilmAnswer::Finish() {
  ISOSCOPE_RETURN_IF_ERROR(writer_->Finish());
  std::error_code error;
  const std::uintmax_t size = std::filesystem::file_size(path_, error);
  if (error) {
    return absl::InternalError(absl::StrCat("the film can't be read: ", error.message()));
  }
  ISOSCOPE_RETURN_IF_ERROR(lease_->SetBytes(static_cast<std::int64_t>(size)));
  HttpResponse response = Header();
  response.file_path = std::exchange(path_, "");
  response.hold = std::move(lease_);
  return response;
}

HttpResponse FilmAnswer::Header() const {
  HttpResponse response;
  response.content_type = FilmMediaType(format_);
  response.headers = {
      {"Cache-Control", "no-store"},
      {"Content-Disposition", absl::StrCat("attachment; filename=\"", NameOfFile(format_), "\"")}};
  return response;
}

}  // namespace isoscope::gateway
