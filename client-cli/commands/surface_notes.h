// Asks a session why surfaces do not show, or have no triangles
// (RenderIsosurfaceRequest.with_notes).

#ifndef ISOSCOPE_CLIENT_CLI_COMMANDS_SURFACE_NOTES_H_
#define ISOSCOPE_CLIENT_CLI_COMMANDS_SURFACE_NOTES_H_

#include <functional>
#include <set>

#include "absl/status/status.h"

#include "client-cli/session/session.h"
#include "clients/cpp/mesh_file/mesh_piece.h"
#include "core/cli/command.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::cli {

// Draws a frame, small and whole, for its notes alone. Writes those that `is_wanted` to standard
// error. Does nothing if the server is older than notes.
absl::Status WriteNotesOf(
    const isoscope::v1::RenderIsosurfaceRequest& frame,
    const std::function<bool(const isoscope::v1::SurfaceNote&)>& is_wanted, Session* session,
    const Context& context);

// Counts the triangles of each surface on their way to another sink. Thread-compatible.
class SurfaceCounter : public client::MeshSink {
 public:
  // `to` outlives it. Finish does not reach it.
  explicit SurfaceCounter(client::MeshSink* to) : to_(*to) {}

  absl::Status Add(const client::MeshPiece& piece) override {
    if (piece.triangle_count() > 0) {
      surfaces_.insert(piece.surface_index);
    }
    return to_.Add(piece);
  }
  absl::Status Finish() override { return absl::OkStatus(); }

  [[nodiscard]] bool HasTriangles(int surface_index) const {
    return surfaces_.count(surface_index) > 0;
  }

 private:
  client::MeshSink& to_;
  std::set<int> surfaces_;  // those with triangles
};

// Writes to standard error why surfaces of an export have no triangles, and which of their labels
// no sample has. Of many such surfaces the first 128.
absl::Status WriteNotesOnMesh(const isoscope::v1::ExportIsosurfaceRequest& request,
                              const SurfaceCounter& counter, Session* session,
                              const Context& context);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_COMMANDS_SURFACE_NOTES_H_
