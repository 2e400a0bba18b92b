// Every request about a dataset takes the same steps:
//
//   1  ListDatasets: finds the dataset that the address names, by name or by id
//   2  for a picture: GetClusterStatus, for the picture revision of its agents; with the id of
//      the dataset and the request it makes the ETag, and the work may end here with 304
//   3  the call itself
//
// An Exchange is one request in work. The functions that wait for answers hold it.

#include "web-gateway/api.h"

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "google/protobuf/io/coded_stream.h"
#include "google/protobuf/io/zero_copy_stream_impl_lite.h"

#include "clients/cpp/connection/like_picture.h"
#include "clients/cpp/connection/mesh_export.h"
#include "clients/cpp/mesh_file/mesh_field.h"
#include "clients/cpp/mesh_file/mesh_piece.h"
#include "clients/cpp/mesh_file/mesh_writer.h"
#include "core/base/retry_delay.h"
#include "core/base/status_macros.h"
#include "core/rpc/field_selection.h"
#include "isoscope/v1/cluster_service.pb.h"
#include "isoscope/v1/dataset_service.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "web-gateway/etag.h"
#include "web-gateway/json.h"
#include "web-gateway/render_query.h"
#include "web-gateway/served_selection.h"
#include "web-gateway/static_files.h"
#include "web-gateway/url.h"

namespace isoscope::gateway {
namespace {

namespace v1 = isoscope::v1;
using OutputOptions = v1::OutputOptions;

constexpr std::int64_t kMaxMeshBytes = std::int64_t{1} << 30;

HttpResponse MethodNotAllowed(absl::string_view method, const std::string& allowed) {
  HttpResponse response =
      ErrorResponse(absl::InvalidArgumentError(absl::StrCat("the method is ", Quoted(method),
                                                            ": this address "
                                                            "takes ",
                                                            allowed)),
                    405);
  response.headers.emplace_back("Allow", allowed);
  return response;
}

// Returns bytes that depend on the content of the message alone.
std::string Serialize(const google::protobuf::Message& message) {
  std::string bytes;
  google::protobuf::io::StringOutputStream stream(&bytes);
  google::protobuf::io::CodedOutputStream coded(&stream);
  coded.SetSerializationDeterministic(true);
  message.SerializeToCodedStream(&coded);
  coded.Trim();
  return bytes;
}

// Moves the requested output out of a response: a picture or a plane, with its type.
absl::Status TakePicture(const v1::RenderIsosurfaceRequest& request,
                         v1::RenderIsosurfaceResponse* response, HttpResponse* answer) {
  answer->content_type = "application/octet-stream";
  switch (request.output().image_format()) {
    case OutputOptions::IMAGE_FORMAT_JPEG:
      answer->content_type = "image/jpeg";
      answer->body = std::move(*response->mutable_jpeg());
      return absl::OkStatus();
    case OutputOptions::IMAGE_FORMAT_RGBA8:
      answer->body = std::move(*response->mutable_rgba8());
      return absl::OkStatus();
    case OutputOptions::IMAGE_FORMAT_NONE:
      answer->body =
          std::move(request.output().depth()           ? *response->mutable_depth()
                    : request.output().surface_index() ? *response->mutable_surface_index()
                    : request.output().position()      ? *response->mutable_position()
                                                       : *response->mutable_normal());
      return absl::OkStatus();
    default:
      answer->content_type = "image/png";
      answer->body = std::move(*response->mutable_png());
      return absl::OkStatus();
  }
}

// An answer is one picture or one plane. INVALID_ARGUMENT for a request of more, or of none.
absl::Status CheckOneOutput(const OutputOptions& output) {
  const int plane_count = static_cast<int>(output.depth()) +
                          static_cast<int>(output.surface_index()) +
                          static_cast<int>(output.position()) + static_cast<int>(output.normal());
  const bool has_image = output.image_format() != OutputOptions::IMAGE_FORMAT_NONE;
  if (plane_count + static_cast<int>(has_image) == 1) {
    return absl::OkStatus();
  }
  return absl::InvalidArgumentError(
      absl::StrCat("output asks for ", has_image ? "a picture and " : "", plane_count,
                   " planes: an answer is one picture, or with IMAGE_FORMAT_NONE one plane"));
}

class Exchange : public std::enable_shared_from_this<Exchange> {
 public:
  Exchange(const ApiOptions& options, CoordinatorClient* client, std::atomic<int>* pictures,
           MeshBudget* meshes, HttpRequest request, std::shared_ptr<RequestScope> cancellation,
           Api::Respond respond)
      : options_(options),
        client_(client),
        pictures_(pictures),
        meshes_(meshes),
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
        Respond(MethodNotAllowed(request_.method, "GET"));
      } else if (is_health) {
        AnswerHealth();
      } else {
        Respond(ServeStaticFile(request_));
      }
      return;
    }
    if (path.size() == 2) {
      RouteCluster(path[1]);
    } else if (path.size() >= 3 && path[1] == "datasets") {
      RouteDataset(path.size() == 3 ? "" : absl::StrJoin(path.begin() + 3, path.end(), "/"));
    } else {
      RespondUnknown();
    }
  }

 private:
  using Self = std::shared_ptr<Exchange>;

  void Respond(HttpResponse response) { std::exchange(respond_, nullptr)(std::move(response)); }
  void RespondError(const absl::Status& status) { Respond(ErrorResponse(status)); }
  void RespondUnknown() {
    RespondError(absl::NotFoundError(absl::StrCat(
        "there is nothing at ",
        Quoted(absl::StrCat("/", absl::StrJoin(request_.target.segments, "/"))),
        ": /v1/capabilities, /v1/status, /v1/datasets, and below /v1/datasets/NAME: histogram, "
        "render, pick, mesh.glb")));
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

  // Returns true if the request has this method; else answers 405.
  bool Takes(absl::string_view method) {
    if (request_.method == method) {
      return true;
    }
    Respond(MethodNotAllowed(request_.method, std::string(method)));
    return false;
  }

  // Returns true if the address has no parameters left; else answers 400.
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
          response.body = is_well ? "ok\n" : absl::StrCat(capabilities.status().message(), "\n");
          self->Respond(std::move(response));
        });
  }

  void RouteCluster(const std::string& name) {
    if (name != "capabilities" && name != "status" && name != "datasets") {
      RespondUnknown();
    } else if (!Takes("GET") || !TakesNoParameters()) {
      return;
    } else if (name == "capabilities") {
      client_->GetCapabilities(call_, AnswerWithJson<v1::GetCapabilitiesResponse>());
    } else if (name == "status") {
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

  void RouteDataset(const std::string& rest) {
    using Step = void (Exchange::*)();
    Step step = nullptr;
    bool is_picture = true;
    if (rest.empty() || rest == "histogram") {
      step = rest.empty() ? &Exchange::AnswerDataset : &Exchange::AnswerHistogram;
      is_picture = false;
    } else if (rest == "render") {
      step = request_.method == "POST" ? &Exchange::RenderPosted : &Exchange::RenderQueried;
    } else if (rest == "pick") {
      step = &Exchange::Pick;
    } else if (rest == "mesh.glb") {
      step = &Exchange::AnswerMesh;
    } else {
      RespondUnknown();
      return;
    }
    const bool takes_post = rest == "pick" || rest == "render";
    if (!(request_.method == "GET" && rest != "pick") &&
        !(request_.method == "POST" && takes_post)) {
      Respond(MethodNotAllowed(request_.method, rest == "pick"     ? "POST"
                                                : rest == "render" ? "GET, POST"
                                                                   : "GET"));
      return;
    }
    if (is_picture && !CountPicture()) {
      return;
    }
    FindDataset(step);
  }

  // Takes one of the places for pictures; answers 429 if there is none.
  bool CountPicture() {
    is_picture_ = true;  // given back by the destructor
    if (pictures_->fetch_add(1) < options_.max_pictures) {
      return true;
    }
    RespondError(
        base::WithRetryDelay(absl::ResourceExhaustedError(absl::StrCat(
                                 options_.max_pictures,
                                 " pictures and meshes are in work, which is the gateway's limit "
                                 "(--max-pictures): ask again later")),
                             absl::Seconds(1)));
    return false;
  }

  void FindDataset(void (Exchange::*next)()) {
    client_->ListDatasets(call_, [self = shared_from_this(),
                                  next](absl::StatusOr<v1::ListDatasetsResponse> list) {
      const absl::Status status = list.ok() ? self->TakeDataset(std::move(*list)) : list.status();
      if (status.ok()) {
        ((*self).*next)();
      } else {
        self->RespondError(status);
      }
    });
  }

  absl::Status TakeDataset(v1::ListDatasetsResponse list) {
    const std::string& name = request_.target.segments[2];
    std::vector<std::string> names;
    v1::Dataset* by_id = nullptr;
    for (v1::Dataset& dataset : *list.mutable_datasets()) {
      if (dataset.name() == name) {
        dataset_ = std::move(dataset);
        return absl::OkStatus();
      }
      if (dataset.dataset_id() == name) {
        by_id = &dataset;
      }
      names.push_back(dataset.name());
    }
    if (by_id != nullptr) {
      dataset_ = std::move(*by_id);
      is_by_id_ = true;
      return absl::OkStatus();
    }
    return absl::NotFoundError(
        absl::StrCat("there is no dataset ", Quoted(name), "; ",
                     names.empty() ? "none is served"
                                   : absl::StrCat("there are: ", absl::StrJoin(names, ", "))));
  }

  void AnswerDataset() {
    if (TakesNoParameters()) {
      Respond(JsonResponse(ToJson(dataset_)));
    }
  }

  void AnswerHistogram() {
    v1::GetHistogramRequest request;
    request.set_dataset(dataset_.name());
    const std::string bins = request_.target.TakeParameter("bins");
    constexpr int kMaxBins = 4096;
    int count = 0;
    if (!bins.empty() && (!absl::SimpleAtoi(bins, &count) || count < 1 || count > kMaxBins)) {
      RespondError(absl::InvalidArgumentError(
          absl::StrCat("bins is ", Quoted(bins), ": a whole number from 1 to ", kMaxBins)));
      return;
    }
    request.set_max_bin_count(count);
    const absl::StatusOr<std::optional<v1::FieldSelection>> selection =
        TakeSelection(&request_.target.query);
    if (!selection.ok()) {
      RespondError(selection.status());
      return;
    }
    if (selection->has_value()) {
      *request.mutable_selection() = **selection;
    }
    if (TakesNoParameters()) {
      client_->GetHistogram(std::move(request), call_, AnswerWithJson<v1::GetHistogramResponse>());
    }
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
    if (!TakesNoParameters()) {
      return;
    }
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

  void RenderPosted() {
    if (!TakesNoParameters()) {
      return;
    }
    absl::Status status = FromJson(request_.body, &render_);
    if (status.ok()) {
      status = SetDataset(&render_);
    }
    if (status.ok()) {
      status = CheckOneOutput(render_.output());
    }
    if (status.ok() && render_.with_trace()) {
      status = absl::InvalidArgumentError(
          "withTrace is true: an answer over HTTP has no trace; ask the coordinator for one");
    }
    if (status.ok() && render_.allow_partial()) {
      status = absl::InvalidArgumentError(
          "allowPartial is true: a picture over HTTP can't say what is missing in it; ask the "
          "coordinator");
    }
    if (!status.ok()) {
      RespondError(status);
      return;
    }
    Render({{"Cache-Control", "no-store"}});
  }

  void RenderQueried() {
    absl::StatusOr<v1::RenderIsosurfaceRequest> render =
        RenderRequestFromQuery(request_.target.query, dataset_);
    if (!render.ok()) {
      RespondError(render.status());
      return;
    }
    render_ = *std::move(render);
    client_->GetClusterStatus(
        call_,
        [self = shared_from_this()](const absl::StatusOr<v1::GetClusterStatusResponse>& cluster) {
          if (cluster.ok()) {
            self->RenderUnlessKnown(client::PictureRevisionOf(*cluster, self->dataset_));
          } else {
            self->RespondError(cluster.status());
          }
        });
  }

  void RenderUnlessKnown(const std::string& picture_revision) {
    if (render_.culling() == v1::CULLING_MASK) {
      Render({{"Cache-Control", "no-store"}});  // approximate
      return;
    }
    const bool may_change = DependsOnLaterSteps(render_.selection(), dataset_);
    std::string digest;
    if (!dataset_.fields().empty()) {
      const auto selection = rpc::ResolveSelection(render_.selection(), dataset_);
      if (!selection.ok()) {
        Render({{"Cache-Control", "no-store"}});  // the coordinator says what there is
        return;
      }
      *render_.mutable_selection() = *selection;
      digest = DigestOfStep(*selection, dataset_);
    }
    const std::string request = Serialize(render_);
    const std::string ranges = RangesOfColors(render_, dataset_);
    std::vector<absl::string_view> parts = {dataset_.dataset_id(), picture_revision, request};
    if (!ranges.empty()) {
      parts.emplace_back(ranges);
    }
    if (!digest.empty()) {
      parts.emplace_back(digest);
    }
    const std::string etag = MakeEtag(parts);
    // The id of a dataset names its first step alone.
    const bool is_named = render_.selection().time_step() == 0;
    const bool is_immutable = is_by_id_ && is_named && !may_change && ranges.empty();
    const bool is_private = options_.is_private || !request_.token.empty();
    const std::vector<std::pair<std::string, std::string>> headers = {
        {"ETag", etag},
        {"Cache-Control", absl::StrCat(is_private ? "private, " : "public, ",
                                       is_immutable ? "max-age=31536000, immutable" : "no-cache")}};
    if (MatchesEtag(request_.if_none_match, etag)) {
      HttpResponse response;
      response.status = 304;
      response.headers = headers;
      Respond(std::move(response));
      return;
    }
    Render(headers);
  }

  void Render(std::vector<std::pair<std::string, std::string>> headers) {
    client_->Render(
        render_, call_,
        [self = shared_from_this(),
         headers = std::move(headers)](absl::StatusOr<v1::RenderIsosurfaceResponse> rendered) {
          if (!rendered.ok()) {
            self->RespondError(rendered.status());
            return;
          }
          HttpResponse response;
          response.headers = headers;
          response.headers.emplace_back(
              "X-Isoscope-Extent",
              absl::StrCat(rendered->extent().width_px(), "x", rendered->extent().height_px()));
          response.headers.emplace_back("X-Isoscope-Camera", ToJson(rendered->camera()));
          if (rendered->has_selection()) {
            response.headers.emplace_back("X-Isoscope-Selection",
                                          ToAsciiJson(rendered->selection()));
          }
          if (rendered->has_time()) {
            response.headers.emplace_back("X-Isoscope-Time", ToJson(rendered->time()));
          }
          const absl::Status taken = TakePicture(self->render_, &*rendered, &response);
          self->Respond(taken.ok() ? std::move(response) : ErrorResponse(taken));
        });
  }

  void AnswerMesh() {
    absl::StatusOr<MeshQuery> query = MeshQueryFromQuery(request_.target.query, dataset_);
    absl::Status status = query.status();
    if (status.ok() && request_.is_head) {
      HttpResponse response = MeshHeader();
      response.has_unknown_length = true;
      Respond(std::move(response));
      return;
    }
    if (status.ok()) {
      const std::optional<client::MeshField> field =
          client::PinSelection(dataset_, &query->request);
      status = BeginMesh(*query, field);
    }
    if (!status.ok()) {
      RespondError(status);
      return;
    }
    client_->Export(
        query->request, call_,
        [self = shared_from_this()](const v1::ExportIsosurfaceResponse& chunk) -> absl::Status {
          ISOSCOPE_ASSIGN_OR_RETURN(const client::MeshPiece piece,
                                    self->decoder_->Decode(chunk.surface_index(), chunk.positions(),
                                                           chunk.normals(), chunk.triangles()));
          ISOSCOPE_RETURN_IF_ERROR(self->CountMeshBytes());
          return self->writer_->Add(piece);
        },
        [self = shared_from_this()](const absl::Status& exported) { self->EndMesh(exported); });
  }

  // Takes a place among the meshes, and creates the file of this one.
  absl::Status BeginMesh(const MeshQuery& query, const std::optional<client::MeshField>& field) {
    ISOSCOPE_ASSIGN_OR_RETURN(mesh_lease_, meshes_->Begin(request_.caller));
    std::error_code error;
    std::string folder = (std::filesystem::temp_directory_path(error) / "isoscope-XXXXXX").string();
    // A private folder: no other user can put a file of this name there.
    if (error || mkdtemp(folder.data()) == nullptr) {
      return absl::FailedPreconditionError(
          absl::StrCat("no folder for temporary files can be made (TMPDIR): ",
                       error ? error.message() : std::system_category().message(errno)));
    }
    mesh_path_ = folder + "/mesh.glb";
    const client::MeshFileOptions file{.path = mesh_path_,
                                       .format = client::MeshFormat::kGlb,
                                       .surfaces = query.surfaces,
                                       .field = field};
    ISOSCOPE_RETURN_IF_ERROR(client::Validate(file));
    decoder_.emplace(static_cast<int>(query.surfaces.size()));
    absl::StatusOr<std::unique_ptr<client::MeshWriter>> writer = client::MeshWriter::Create(file);
    if (!writer.ok()) {
      RemoveTemporaryFile(mesh_path_);
      return writer.status();
    }
    writer_ = *std::move(writer);
    return absl::OkStatus();
  }

  // Counts the bytes on disk of the mesh so far.
  [[nodiscard]] absl::Status CountMeshBytes() const {
    constexpr std::int64_t kVectorBytes = 3 * sizeof(float);  // also the size of three indices
    const std::int64_t vertices = kVectorBytes * decoder_->vertex_count();
    const std::int64_t triangles = kVectorBytes * decoder_->triangle_count();
    const std::int64_t bytes = 2 * vertices + triangles;
    // While the file is assembled, normals and then indices are on disk twice.
    const std::int64_t disk_bytes = bytes + std::max(vertices, triangles);
    if (bytes > kMaxMeshBytes || disk_bytes > options_.max_mesh_bytes) {
      return absl::ResourceExhaustedError(
          absl::StrCat("the mesh has ", bytes, " bytes or more, and the gateway's limit is ",
                       kMaxMeshBytes, ", or two thirds of --max-mesh-bytes ",
                       options_.max_mesh_bytes, ": clip it, or use 'isoscope export'"));
    }
    return mesh_lease_->SetBytes(disk_bytes);
  }

  static HttpResponse MeshHeader() {
    HttpResponse response;
    response.content_type = "model/gltf-binary";
    response.headers = {{"Cache-Control", "no-store"},
                        {"Content-Disposition", "attachment; filename=\"mesh.glb\""}};
    return response;
  }

  void EndMesh(absl::Status status) {
    if (status.ok()) {
      status = writer_->Finish();
    }
    if (status.ok()) {
      status = mesh_lease_->SetBytes(writer_->size_bytes());
    }
    writer_.reset();  // without Finish, this removes the file
    if (!status.ok()) {
      RemoveTemporaryFile(mesh_path_);
      RespondError(status);
      return;
    }
    HttpResponse response = MeshHeader();
    response.file_path = mesh_path_;
    response.hold = std::move(mesh_lease_);
    Respond(std::move(response));
  }

  const ApiOptions options_;
  CoordinatorClient* const client_;
  std::atomic<int>* const pictures_;
  MeshBudget* const meshes_;
  HttpRequest request_;
  const CallOptions call_;
  Api::Respond respond_;
  bool is_picture_ = false;

  v1::Dataset dataset_;
  bool is_by_id_ = false;
  v1::RenderIsosurfaceRequest render_;
  std::shared_ptr<MeshBudget::Lease> mesh_lease_;
  std::string mesh_path_;
  std::optional<client::MeshDecoder> decoder_;
  std::unique_ptr<client::MeshWriter> writer_;
};

}  // namespace

void Api::Answer(HttpRequest request, std::shared_ptr<RequestScope> cancellation, Respond respond) {
  std::make_shared<Exchange>(options_, client_, &pictures_in_work_, &meshes_, std::move(request),
                             std::move(cancellation), std::move(respond))
      ->Route();
}

}  // namespace isoscope::gateway
