// The mesh of an answer, from the coordinator's chunks to a temporary file.

#ifndef ISOSCOPE_WEB_GATEWAY_API_MESH_ANSWER_H_
#define ISOSCOPE_WEB_GATEWAY_API_MESH_ANSWER_H_

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "clients/cpp/mesh_file/mesh_field.h"
#include "clients/cpp/mesh_file/mesh_piece.h"
#include "clients/cpp/mesh_file/mesh_writer.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "web-gateway/api/mesh_budget.h"
#include "web-gateway/http/http_message.h"

namespace isoscope::gateway {

// Returns the type of a file: "model/gltf-binary"; that of bytes where none is registered.
std::string MeshMediaType(client::MeshFormat format);

// Thread-compatible.
class MeshAnswer {
 public:
  // Takes a place of `caller` in the budget, which outlives the answer, and creates the file.
  // `max_disk_bytes`: what this mesh may take on disk. `field`: what the file says of it.
  // REQUIRES: the format can hold the surfaces (client::Validate).
  static absl::StatusOr<std::unique_ptr<MeshAnswer>> Begin(
      client::MeshFormat format, const std::vector<client::MeshSurface>& surfaces,
      const std::optional<client::MeshField>& field, const std::string& caller,
      std::int64_t max_disk_bytes, MeshBudget* budget);
  // Removes the file, unless Finish has returned it.
  ~MeshAnswer();
  MeshAnswer(const MeshAnswer&) = delete;
  MeshAnswer& operator=(const MeshAnswer&) = delete;

  // Writes the next chunk. RESOURCE_EXHAUSTED if the mesh is too large.
  absl::Status Add(const isoscope::v1::ExportIsosurfaceResponse& chunk);
  // Returns the complete answer, which holds the place in the budget. No call follows.
  absl::StatusOr<HttpResponse> Finish();

  // Returns an answer without a mesh.
  static HttpResponse Header(client::MeshFormat format);

 private:
  MeshAnswer(client::MeshFormat format, std::int64_t max_disk_bytes, std::size_t surface_count,
             std::shared_ptr<MeshBudget::Lease> lease)
      : format_(format),
        max_disk_bytes_(max_disk_bytes),
        lease_(std::move(lease)),
        decoder_(static_cast<int>(surface_count)) {}
  // Counts the bytes on disk of the mesh so far.
  [[nodiscard]] absl::Status CountBytes() const;

  const client::MeshFormat format_;
  const std::int64_t max_disk_bytes_;
  std::shared_ptr<MeshBudget::Lease> lease_;
  client::MeshDecoder decoder_;
  std::string path_;  // empty: there is no file, or it is the answer's
  std::unique_ptr<client::MeshWriter> writer_;
};

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_API_MESH_ANSWER_H_
