#include "web-gateway/api/routes.h"

#include <cstddef>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

#include "isoscope/v1/cluster_service.pb.h"
#include "isoscope/v1/dataset_service.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "web-gateway/api/film_answer.h"
#include "web-gateway/api/mesh_answer.h"

namespace isoscope::gateway {
namespace {

namespace v1 = isoscope::v1;

// "glb" becomes "Glb".
std::string Capitalized(absl::string_view word) {
  std::string text(word);
  text[0] = static_cast<char>(text[0] - 'a' + 'A');
  return text;
}

Operation MeshOperation(client::MeshFormat format) {
  const absl::string_view name = client::NameOf(format);
  return {.endpoint = Endpoint::kMesh,
          .name = absl::StrCat("getMesh", Capitalized(name)),
          .path = absl::StrCat("/v1/datasets/{name}/mesh.", name),
          .summary = absl::StrCat("The whole surfaces as one mesh, a file of format ", name, "."),
          .parameters = MeshParameters(),
          .media_types = {MeshMediaType(format)},
          .mesh_format = format};
}

Operation FilmOperation(client::AnimationFormat format) {
  const absl::string_view name = client::NameOf(format);
  return {.endpoint = Endpoint::kFilm,
          .name = absl::StrCat("getFilm", Capitalized(name)),
          .path = absl::StrCat("/v1/datasets/{name}/film.", name),
          .summary =
              absl::StrCat("A turn, a sweep of isovalues or a series of steps as one ",
                           format == client::AnimationFormat::kWebp ? "animated WebP, without loss."
                                                                    : "animated PNG."),
          .parameters = FilmParameters(),
          .media_types = {FilmMediaType(format)},
          .film_format = format};
}

std::vector<Operation> MakeOperations() {
  std::vector<Operation> operations = {
      {.endpoint = Endpoint::kOpenApi,
       .name = "getOpenApi",
       .path = "/v1/openapi.json",
       .summary = "This document.",
       .media_types = {"application/json"}},
      {.endpoint = Endpoint::kCapabilities,
       .name = "getCapabilities",
       .path = "/v1/capabilities",
       .summary = "Version, features and limits of the coordinator.",
       .answer = v1::GetCapabilitiesResponse::descriptor()},
      {.endpoint = Endpoint::kStatus,
       .name = "getStatus",
       .path = "/v1/status",
       .summary = "State and load of the cluster, without the frames in work.",
       .answer = v1::GetClusterStatusResponse::descriptor()},
      {.endpoint = Endpoint::kDatasets,
       .name = "listDatasets",
       .path = "/v1/datasets",
       .summary = "The datasets that are served.",
       .answer = v1::ListDatasetsResponse::descriptor()},
      {.endpoint = Endpoint::kDataset,
       .name = "getDataset",
       .path = "/v1/datasets/{name}",
       .summary = "One dataset: grid, fields, time steps, labels.",
       .answer = v1::Dataset::descriptor()},
      {.endpoint = Endpoint::kHistogram,
       .name = "getHistogram",
       .path = "/v1/datasets/{name}/histogram",
       .summary = "The samples by value, and suggested isovalues.",
       .parameters = HistogramParameters(),
       .answer = v1::GetHistogramResponse::descriptor()},
      {.endpoint = Endpoint::kPicture,
       .name = "getPicture",
       .path = "/v1/datasets/{name}/render",
       .summary = "A picture, or the depth of its pixels.",
       .parameters = PictureParameters(),
       .media_types = {"image/png", "image/jpeg", "image/webp", "application/octet-stream"}},
      {.endpoint = Endpoint::kPostedPicture,
       .name = "renderPicture",
       .path = "/v1/datasets/{name}/render",
       .method = "POST",
       .summary = "The picture, or the one plane, that the body asks for.",
       .parameters = ExtrasParameters(),
       .body = v1::RenderIsosurfaceRequest::descriptor(),
       .media_types = {"image/png", "image/jpeg", "application/octet-stream"}},
      {.endpoint = Endpoint::kPick,
       .name = "pick",
       .path = "/v1/datasets/{name}/pick",
       .method = "POST",
       .summary = "The points of the surfaces at pixels of a picture.",
       .body = v1::PickSurfaceRequest::descriptor(),
       .answer = v1::PickSurfaceResponse::descriptor()}};
  for (const client::MeshFormat format : client::kMeshFormats) {
    operations.push_back(MeshOperation(format));
  }
  for (const client::AnimationFormat format : client::kAnimationFormats) {
    operations.push_back(FilmOperation(format));
  }
  return operations;
}

bool IsPathOf(const std::string& path, const std::vector<std::string>& segments) {
  const std::vector<absl::string_view> wanted =
      absl::StrSplit(absl::string_view(path).substr(1), '/');
  bool is_same = wanted.size() == segments.size();
  for (std::size_t i = 0; is_same && i < wanted.size(); ++i) {
    is_same = wanted[i] == "{name}" || wanted[i] == segments[i];
  }
  return is_same;
}

}  // namespace

const std::vector<Operation>& Operations() {
  static const std::vector<Operation> operations = MakeOperations();
  return operations;
}

FoundRoute FindRoute(absl::string_view method, const std::vector<std::string>& segments) {
  FoundRoute found;
  for (const Operation& operation : Operations()) {
    if (!IsPathOf(operation.path, segments)) {
      continue;
    }
    absl::StrAppend(&found.methods, found.methods.empty() ? "" : ", ", operation.method,
                    operation.method == "GET" ? ", HEAD" : "");
    if (operation.method == method) {
      found.operation = &operation;
    }
  }
  return found;
}

}  // namespace isoscope::gateway
