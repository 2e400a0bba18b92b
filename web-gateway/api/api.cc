// Every request about a dataset makes two calls:
//
//   1  GetDataset, by the name or the id in the address; of an unknown one ListDatasets tells the
//      others. Id and picture revision of its answer make the ETag of a picture, with the request:
//      the work may end here with 304
//   2  the call itself
//
// What a request means is in the table of routes.h. An Exchange is one request in work. The
// functions that wait for answers hold it. Annotations are drawn, and pictures put into a WebP or a
// film, after the call, on a thread of their own, one picture at a time: decoded pictures are large.

#include "web-gateway/api/api.h"

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

#include "clients/cpp/connection/mesh_export.h"
#include "clients/cpp/mesh_file/mesh_field.h"
#include "core/base/retry_delay.h"
#include "core/base/status_macros.h"
#include "isoscope/v1/cluster_service.pb.h"
#include "isoscope/v1/dataset_service.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "web-gateway/api/film_answer.h"
#include "web-gateway/api/film_frames.h"
#include "web-gateway/api/json.h"
#include "web-gateway/api/mesh_answer.h"
#include "web-gateway/api/openapi.h"
#include "web-gateway/api/picture_answer.h"
#include "web-gateway/api/picture_extras.h"
#include "web-gateway/api/render_query.h"
#include "web-gateway/api/routes.h"
#include "web-gateway/http/etag.h"
#include "web-gateway/http/static_files.h"
#include "web-gateway/http/url.h"

namespace isoscope::gateway {
namespace {

namespace v1 = isoscope::v1;

constexpr char kGet[] = "GET, HEAD";

HttpResponse MethodNotAllowed(absl::string_view method, const std::string& allowed) {
  HttpResponse response =
      ErrorResponse(absl::InvalidArgumentError(absl::StrCat("the method is ", Quoted(method),
                                                            ": this address takes ", allowed)),
                    405);
  response.headers.emplace_back("Allow", allowed);
  return response;
}

class Exchange : public std::enable_shared_from_this<Exchange> {
 public:
  Exchange(const ApiOptions& options, CoordinatorClient* client, std::atomic<int>* pictures,
           MeshBudget* meshes, base::Executor* drawing, HttpRequest request,
           std::shared_ptr<RequestScope> cancellation, Api::Respond respond)
      : options_(options),
        client_(client),
        pictures_(pictures),
        meshes_(meshes),
        drawing_(drawing),
        request_(std::move(request)),
        call_{.scope = std::move(cancellation), .token = request_.token},
        respond_(std::move(respond)) {}
  ~Exchange() {
    if (is_picture_) {
      pictures_->fetch_sub(1);
    }
  }
  Exchange(const Exchange&) = delete;
  Exchange& operator=(const Exchange&) = delete;

  void Route() {
    const std::vector<std::string>& path = request_.target.segments;
    if (path.empty() || path[0] != "v1") {
      const bool is_health = path.size() == 1 && path[0] == "healthz";
      if (request_.method != "GET") {
        Respond(MethodNotAllowed(request_.method, kGet));
      } else if (is_health) {
        AnswerHealth();
      } else {
        Respond(ServeStaticFile(request_, PagePolicy(options_.framing_origins)));
      }
      return;
    }
    const FoundRoute route = FindRoute(request_.method, path);
    if (route.methods.empty()) {
      RespondUnknown();
    } else if (route.operation == nullptr) {
      Respond(MethodNotAllowed(request_.method, route.methods));
    } else {
      Answer(*route.operation);
    }
  }

 private:
  void Respond(HttpResponse response) { std::exchange(respond_, nullptr)(std::move(response)); }
  void RespondError(const absl::Status& status) { Respond(ErrorResponse(status)); }
  void RespondUnknown() {
    std::vector<std::string> paths;
    for (const Operation& operation : Operations()) {
      if (paths.empty() || paths.back() != operation.path) {
        paths.push_back(operation.path);
      }
    }
    RespondError(absl::NotFoundError(
        absl::StrCat("there is nothing at ",
                     Quoted(absl::StrCat("/", absl::StrJoin(request_.target.segments, "/"))),
                     "; there are: ", absl::StrJoin(paths, ", "))));
  }

  void Answer(const Operation& operation) {
    operation_ = &operation;
    if (operation.parameters.empty() && !TakesNoParameters()) {
      return;
    }
    if (operation.takes_place() && !CountPicture()) {
      return;
    }
    if (operation.is_of_dataset()) {
      FindDataset();
    } else {
      AnswerOfCluster();
    }
  }

  // Answers with the message, or with an error.
  template <typename Message>
  std::function<void(absl::StatusOr<Message>)> AnswerWithJson() {
    return [self = shared_from_this()](absl::StatusOr<Message> message) {
      if (message.ok()) {
        self->Respond(JsonResponse(ToJson(*message)));
      } else {
        self->RespondError(message.status());
      }
    };
  }

  // Returns true if the address has no parameters; else answers 400.
  bool TakesNoParameters() {
    if (request_.target.query.empty()) {
      return true;
    }
    RespondError(absl::InvalidArgumentError(
        absl::StrCat("there is no parameter ", Quoted(request_.target.query[0].first), " here")));
    return false;
  }

  void AnswerHealth() {
    client_->GetCapabilities(
        call_, [self = shared_from_this()](
                   const absl::StatusOr<v1::GetCapabilitiesResponse>& capabilities) {
          HttpResponse response;
          response.content_type = "text/plain; charset=utf-8";
          response.headers = {{"Cache-Control", "no-store"}};
          // A coordinator that requires the user's token is healthy, too.
          const bool is_well =
              capabilities.ok() ||
              (self->options_.passes_tokens && absl::IsUnauthenticated(capabilities.status()));
          response.status = is_well ? 200 : 503;
          response.body = is_well ? "ok\n"
                          : absl::IsDeadlineExceeded(capabilities.status())
                              ? "the coordinator does not answer: look at its process and its log\n"
                              : absl::StrCat(capabilities.status().message(), "\n");
          self->Respond(std::move(response));
        });
  }

  void AnswerOfCluster() {
    if (operation_->endpoint == Endpoint::kOpenApi) {
      Respond(JsonResponse(OpenApiDocument()));
    } else if (operation_->endpoint == Endpoint::kCapabilities) {
      client_->GetCapabilities(call_, AnswerWithJson<v1::GetCapabilitiesResponse>());
    } else if (operation_->endpoint == Endpoint::kStatus) {
      client_->GetClusterStatus(call_, [answer = AnswerWithJson<v1::GetClusterStatusResponse>()](
                                           absl::StatusOr<v1::GetClusterStatusResponse> status) {
        if (status.ok()) {
          status->clear_frames();  // they name addresses of other users
        }
        answer(std::move(status));
      });
    } else {
      client_->ListDatasets(call_, AnswerWithJson<v1::ListDatasetsResponse>());
    }
  }

  void AnswerOfDataset() {
    switch (operation_->endpoint) {
      case Endpoint::kHistogram:
        return AnswerHistogram();
      case Endpoint::kPicture:
        return RenderQueried();
      case Endpoint::kPostedPicture:
        return RenderPosted();
      case Endpoint::kPick:
        return Pick();
      case Endpoint::kMesh:
        return AnswerMesh();
      case Endpoint::kFilm:
        return AnswerFilm();
      default:
        return Respond(JsonResponse(ToJson(dataset_)));
    }
  }

  // Takes one of the places for pictures; answers 429 if there is none.
  bool CountPicture() {
    is_picture_ = true;  // given back by the destructor
    if (pictures_->fetch_add(1) < options_.max_pictures) {
      return true;
    }
    RespondError(base::WithRetryDelay(
        absl::ResourceExhaustedError(
            absl::StrCat(options_.max_pictures,
                         " pictures, meshes and films are in work, which is the gateway's limit "
                         "(--max-pictures): ask again later")),
        absl::Seconds(1)));
    return false;
  }

  void FindDataset() {
    v1::GetDatasetRequest request;
    request.set_name(request_.target.segments[2]);
    client_->GetDataset(std::move(request), call_,
                        [self = shared_from_this()](absl::StatusOr<v1::GetDatasetResponse> found) {
                          const std::string& asked = self->request_.target.segments[2];
                          if (found.ok()) {
                            self->is_by_id_ = found->dataset().name() != asked &&
                                              found->dataset().dataset_id() == asked;
                            self->picture_revision_ = found->picture_revision();
                            self->dataset_ = std::move(*found->mutable_dataset());
                            self->AnswerOfDataset();
                          } else if (absl::IsNotFound(found.status())) {
                            self->RespondUnknownDataset();
                          } else {
                            self->RespondError(found.status());
                          }
                        });
  }

  // The list leaves out datasets whose agents are all lost.
  void RespondUnknownDataset() {
    client_->ListDatasets(
        call_, [self = shared_from_this()](const absl::StatusOr<v1::ListDatasetsResponse>& list) {
          if (!list.ok()) {
            self->RespondError(list.status());
            return;
          }
          std::vector<std::string> names;
          for (const v1::Dataset& dataset : list->datasets()) {
            names.push_back(dataset.name());
          }
          self->RespondError(absl::NotFoundError(absl::StrCat(
              "there is no dataset ", Quoted(self->request_.target.segments[2]), "; ",
              names.empty() ? "none is served"
                            : absl::StrCat("there are: ", absl::StrJoin(names, ", ")))));
        });
  }

  void AnswerHistogram() {
    absl::StatusOr<v1::GetHistogramRequest> request =
        HistogramRequestFromQuery(request_.target.query, dataset_);
    if (!request.ok()) {
      RespondError(request.status());
      return;
    }
    client_->GetHistogram(*std::move(request), call_, AnswerWithJson<v1::GetHistogramResponse>());
  }

  // Sets the dataset of the address in a frame of the body.
  absl::Status SetDataset(v1::RenderIsosurfaceRequest* frame) {
    if (!frame->dataset().empty() && frame->dataset() != dataset_.name()) {
      return absl::InvalidArgumentError(
          absl::StrCat("dataset is ", Quoted(frame->dataset()), ", but the address names ",
                       Quoted(dataset_.name()), ": leave it out of the body"));
    }
    frame->set_dataset(dataset_.name());
    return absl::OkStatus();
  }

  void Pick() {
    v1::PickSurfaceRequest request;
    absl::Status status = FromJson(request_.body, &request);
    if (status.ok()) {
      status = SetDataset(request.mutable_frame());
    }
    if (!status.ok()) {
      RespondError(status);
      return;
    }
    client_->PickSurface(std::move(request), call_, AnswerWithJson<v1::PickSurfaceResponse>());
  }

  absl::Status ReadPosted() {
    ISOSCOPE_ASSIGN_OR_RETURN(extras_, ExtrasFromQuery(request_.target.query));
    ISOSCOPE_RETURN_IF_ERROR(FromJson(request_.body, &render_));
    ISOSCOPE_RETURN_IF_ERROR(SetDataset(&render_));
    ISOSCOPE_RETURN_IF_ERROR(CheckAnswerable(render_));
    return CheckExtras(extras_, render_, picture_revision_);
  }

  void RenderPosted() {
    if (const absl::Status status = ReadPosted(); !status.ok()) {
      RespondError(status);
      return;
    }
    Render({{"Cache-Control", "no-store"}});
  }

  absl::Status ReadQuery() {
    ISOSCOPE_ASSIGN_OR_RETURN(PictureQuery query,
                              PictureQueryFromQuery(request_.target.query, dataset_));
    render_ = std::move(query.request);
    extras_ = std::move(query.extras);
    return CheckExtras(extras_, render_, picture_revision_);
  }

  void RenderQueried() {
    if (const absl::Status status = ReadQuery(); !status.ok()) {
      RespondError(status);
      return;
    }
    const PictureCaching caching =
        CachingOf(dataset_, picture_revision_, is_by_id_,
                  options_.is_private || !request_.token.empty(), KeyOf(extras_), &render_);
    if (caching.etag.empty() || !MatchesEtag(request_.if_none_match, caching.etag)) {
      Render(caching.headers);
      return;
    }
    HttpResponse response;
    response.status = 304;
    response.headers = caching.headers;
    Respond(std::move(response));
  }

  using Headers = std::vector<std::pair<std::string, std::string>>;

  void Render(Headers headers) {
    client_->Render(
        render_, call_,
        [self = shared_from_this(), headers = std::move(headers)](
            absl::StatusOr<v1::RenderIsosurfaceResponse> rendered) mutable {
          if (!rendered.ok()) {
            self->RespondError(rendered.status());
          } else if (self->extras_.any()) {
            self->DrawExtras(std::move(headers), *std::move(rendered));
          } else {
            self->Respond(PictureResponse(self->render_, std::move(headers), *std::move(rendered)));
          }
        });
  }

  void DrawExtras(Headers headers, v1::RenderIsosurfaceResponse rendered) {
    const bool is_queued =
        drawing_->TrySchedule([self = shared_from_this(), headers = std::move(headers),
                               rendered = std::move(rendered)]() mutable {
          absl::Status status = self->call_.scope->Check();  // a client that left waits for none
          if (status.ok()) {
            status = AddExtras(self->extras_, self->render_, self->dataset_,
                               self->picture_revision_, &rendered);
          }
          HttpResponse response;
          if (status.ok()) {
            response = PictureResponse(self->render_, std::move(headers), std::move(rendered));
            status = self->extras_.is_webp ? ConvertToWebp(&response) : absl::OkStatus();
          }
          self->Respond(status.ok() ? std::move(response) : ErrorResponse(status));
        });
    if (!is_queued) {
      RespondError(base::WithRetryDelay(
          absl::ResourceExhaustedError("too many pictures wait for their annotations"),
          absl::Seconds(1)));
    }
  }

  void AnswerMesh() {
    absl::StatusOr<MeshQuery> query =
        MeshQueryFromQuery(operation_->mesh_format, request_.target.query, dataset_);
    if (!query.ok()) {
      RespondError(query.status());
      return;
    }
    const std::optional<client::MeshField> field = client::PinSelection(dataset_, &query->request);
    absl::StatusOr<std::unique_ptr<MeshAnswer>> mesh =
        MeshAnswer::Begin(operation_->mesh_format, query->surfaces, field, request_.caller,
                          options_.max_mesh_bytes, meshes_);
    if (!mesh.ok()) {
      RespondError(mesh.status());
      return;
    }
    mesh_ = *std::move(mesh);
    client_->Export(
        query->request, call_,
        // The answer of a HEAD is known with the first piece: the export ends there.
        [self = shared_from_this()](const v1::ExportIsosurfaceResponse& chunk) {
          self->has_mesh_begun_ = true;
          return self->request_.is_head ? absl::CancelledError("the answer is known")
                                        : self->mesh_->Add(chunk);
        },
        [self = shared_from_this()](const absl::Status& exported) {
          absl::StatusOr<HttpResponse> response = self->MeshResponse(exported);
          self->mesh_.reset();  // an answer that failed removes its file first
          self->Respond(response.ok() ? *std::move(response) : ErrorResponse(response.status()));
        });
  }

  // `exported`: how the export ended. A HEAD has ended it with the first piece.
  absl::StatusOr<HttpResponse> MeshResponse(const absl::Status& exported) {
    if (!request_.is_head || (!exported.ok() && !has_mesh_begun_)) {
      return exported.ok() ? mesh_->Finish() : exported;
    }
    if (!has_mesh_begun_) {  // the mesh is empty
      ISOSCOPE_ASSIGN_OR_RETURN(const HttpResponse empty, mesh_->Finish());
      RemoveTemporaryFile(empty.file_path);
    }
    HttpResponse response = MeshAnswer::Header(operation_->mesh_format);
    response.has_unknown_length = true;
    return response;
  }

  absl::StatusOr<std::unique_ptr<FilmAnswer>> BeginFilm() {
    ISOSCOPE_ASSIGN_OR_RETURN(FilmQuery film, FilmQueryFromQuery(request_.target.query, dataset_));
    ISOSCOPE_RETURN_IF_ERROR(CheckFilm(operation_->film_format, film));
    return FilmAnswer::Begin(operation_->film_format, std::move(film), dataset_, request_.caller,
                             options_.max_mesh_bytes, meshes_);
  }

  void AnswerFilm() {
    absl::StatusOr<std::unique_ptr<FilmAnswer>> film = BeginFilm();
    if (!film.ok()) {
      RespondError(film.status());
      return;
    }
    DrawFilm(
        *std::move(film),
        {.client = client_, .call = call_, .drawing = drawing_, .is_head = request_.is_head},
        [self = shared_from_this()](absl::StatusOr<HttpResponse> response) {
          self->Respond(response.ok() ? *std::move(response) : ErrorResponse(response.status()));
        });
  }

  const ApiOptions options_;
  CoordinatorClient* const client_;
  std::atomic<int>* const pictures_;
  MeshBudget* const meshes_;
  base::Executor* const drawing_;
  HttpRequest request_;
  const CallOptions call_;
  Api::Respond respond_;
  const Operation* operation_ = nullptr;
  bool is_picture_ = false;

  v1::Dataset dataset_;
  bool is_by_id_ = false;
  std::string picture_revision_;
  v1::RenderIsosurfaceRequest render_;
  PictureExtras extras_;
  std::unique_ptr<MeshAnswer> mesh_;
  bool has_mesh_begun_ = false;
};

}  // namespace

void Api::Answer(HttpRequest request, std::shared_ptr<RequestScope> cancellation, Respond respond) {
  std::make_shared<Exchange>(options_, client_, &pictures_in_work_, &meshes_, drawing_.get(),
                             std::move(request), std::move(cancellation), std::move(respond))
      ->Route();
}

}  // namespace isoscope::gateway
