// The parameters of addresses: those of the command line, parsed by the same code.
// "?isovalue=60&clip_plane=0,0,1,20" is "--isovalue=60 --clip-plane=0,0,1,20". Each address has one
// declaration of its parameters, by which it is parsed, and which the OpenAPI document shows.

#ifndef ISOSCOPE_WEB_GATEWAY_API_RENDER_QUERY_H_
#define ISOSCOPE_WEB_GATEWAY_API_RENDER_QUERY_H_

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "clients/cpp/mesh_file/mesh_writer.h"
#include "clients/cpp/picture_file/annotations.h"
#include "clients/cpp/request/sweep_flags.h"
#include "core/cli/command_description.h"
#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/dataset_service.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "web-gateway/api/picture_extras.h"
#include "web-gateway/http/url.h"

namespace isoscope::gateway {

// A table of parameters. The names begin with dashes, as those of flags.
using ParameterTable = std::vector<cli::FlagDescription>;

// The errors of the functions below: INVALID_ARGUMENT names the parameter, its value and the allowed
// values; also for an unknown one.

struct PictureQuery {
  isoscope::v1::RenderIsosurfaceRequest request;
  PictureExtras extras;
};
// Returns the request for a picture of `dataset`. Parameters: the flags of `isoscope render` that
// affect a pixel, with '-' or '_', those of PictureExtras, and
//   format   png (default), jpeg, webp (lossless, of the PNG's pixels), or depth: float32 of each
//            pixel, little-endian
//   quality  of a JPEG, 1 to 100
absl::StatusOr<PictureQuery> PictureQueryFromQuery(const QueryParameters& query,
                                                   const isoscope::v1::Dataset& dataset);
ParameterTable PictureParameters();

struct FilmQuery {
  isoscope::v1::RenderIsosurfaceRequest first;  // of the first frame
  client::SweepFlags sweep;                     // its steps are found
  client::Annotations annotations;
};
// Returns a film of `dataset`. Parameters: those of a picture without format, quality and record, and
// the flags of `isoscope render` for several frames: isovalue=A:B:STEP, step=A:B, repeat, orbit, fps.
absl::StatusOr<FilmQuery> FilmQueryFromQuery(const QueryParameters& query,
                                             const isoscope::v1::Dataset& dataset);
ParameterTable FilmParameters();

// The parameters beside a posted request: those of PictureExtras.
absl::StatusOr<PictureExtras> ExtrasFromQuery(const QueryParameters& query);
ParameterTable ExtrasParameters();

struct MeshQuery {
  isoscope::v1::ExportIsosurfaceRequest request;
  std::vector<client::MeshSurface> surfaces;  // as many as the request has
};
// Parameters: isovalue, color, surface, label, labels, clip-plane, clip-box, field, component, time,
// step. INVALID_ARGUMENT also if the format can't hold the surfaces.
absl::StatusOr<MeshQuery> MeshQueryFromQuery(client::MeshFormat format,
                                             const QueryParameters& query,
                                             const isoscope::v1::Dataset& dataset);
ParameterTable MeshParameters();

// Parameters: bins, 1 to 4096; field, component, time and step.
absl::StatusOr<isoscope::v1::GetHistogramRequest> HistogramRequestFromQuery(
    const QueryParameters& query, const isoscope::v1::Dataset& dataset);
ParameterTable HistogramParameters();

// Returns a sentence about flags as one about parameters: "--zoom" becomes "zoom". Commands in
// backticks stay as they are typed.
std::string WithoutDashes(absl::string_view message);

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_API_RENDER_QUERY_H_
