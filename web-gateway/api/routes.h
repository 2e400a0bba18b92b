// The addresses of the HTTP interface: one table, by which requests are answered and which the
// OpenAPI document shows.

#ifndef ISOSCOPE_WEB_GATEWAY_API_ROUTES_H_
#define ISOSCOPE_WEB_GATEWAY_API_ROUTES_H_

#include <string>
#include <vector>

#include "absl/strings/string_view.h"

#include "clients/cpp/mesh_file/mesh_writer.h"
#include "clients/cpp/picture_file/animation_writer.h"
#include "web-gateway/api/render_query.h"

namespace google::protobuf {
class Descriptor;
}  // namespace google::protobuf

namespace isoscope::gateway {

// What an operation answers.
enum class Endpoint {
  kOpenApi,
  kCapabilities,
  kStatus,
  kDatasets,
  kDataset,
  kHistogram,
  kPicture,
  kPostedPicture,
  kPick,
  kMesh,
  kFilm,
};

// One method of an address below /v1/.
struct Operation {
  Endpoint endpoint;
  std::string name;                // of the OpenAPI document: "getDataset"
  std::string path;                // "/v1/datasets/{name}/render": {name} is any one segment
  std::string method = "GET";      // GET, which HEAD may take the place of, or POST
  std::string summary;             // one sentence
  ParameterTable parameters = {};  // of the query
  // The messages whose JSON body and answer are; null: none.
  const google::protobuf::Descriptor* body = nullptr;
  const google::protobuf::Descriptor* answer = nullptr;
  std::vector<std::string> media_types = {};  // of an answer that is no message
  client::MeshFormat mesh_format = client::MeshFormat::kGlb;
  client::AnimationFormat film_format = client::AnimationFormat::kWebp;

  // Whether it takes one of the places for pictures, meshes and films.
  [[nodiscard]] bool takes_place() const {
    return endpoint == Endpoint::kPicture || endpoint == Endpoint::kPostedPicture ||
           endpoint == Endpoint::kPick || endpoint == Endpoint::kMesh ||
           endpoint == Endpoint::kFilm;
  }
  [[nodiscard]] bool is_of_dataset() const {
    return takes_place() || endpoint == Endpoint::kDataset || endpoint == Endpoint::kHistogram;
  }
};

// All operations; those of one address follow each other.
const std::vector<Operation>& Operations();

struct FoundRoute {
  const Operation* operation = nullptr;  // null: the address does not take the method
  // That the address takes: "GET, HEAD, POST"; empty: there is no such address.
  std::string methods = {};
};
// Finds the operation of a path in segments. `method`: GET also for HEAD.
FoundRoute FindRoute(absl::string_view method, const std::vector<std::string>& segments);

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_API_ROUTES_H_
