// Asks a session why surfaces do not show, or have no triangles
// (RenderIsosurfaceRequest.with_notes).

#ifndef ISOSCOPE_CLIENT_CLI_COMMANDS_SURFACE_NOTES_H_
#define ISOSCOPE_CLIENT_CLI_COMMANDS_SURFACE_NOTES_H_

#include <functional>

#include "absl/status/status.h"

#include "client-cli/session/session.h"
#include "core/cli/command.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::cli {

// Draws a frame, small and whole, for its notes alone. Writes those that `is_wanted` to standard
// error. Does nothing if the server is older than notes.
absl::Status WriteNotesOf(const isoscope::v1::RenderIsosurfaceRequest& frame,
                          const std::function<bool(const isoscope::v1::SurfaceNote&)>& is_wanted,
                          Session* session, const Context& context);

// Writes to standard error why surfaces of an export have no triangles, and which of their labels
// no sample has, for the first 128 such surfaces. `has_triangles` is asked by surface.
absl::Status WriteNotesOnMesh(const isoscope::v1::ExportIsosurfaceRequest& request,
                              const std::function<bool(int)>& has_triangles, Session* session,
                              const Context& context);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_COMMANDS_SURFACE_NOTES_H_
