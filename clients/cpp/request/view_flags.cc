#include "clients/cpp/request/view_flags.h"

#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"

#include "clients/cpp/request/camera_file.h"
#include "clients/cpp/request/parse_value.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/cli/usage.h"
#include "core/math/box.h"
#include "core/volume/patient_frame.h"
#include "wire/first_look.h"
#include "wire/proto_convert.h"

namespace isoscope::client {
namespace {

namespace v1 = isoscope::v1;
using view::NamedView;

constexpr char kGroup[] = "Views";

absl::StatusOr<NamedView> ParseView(absl::string_view text) {
  std::vector<std::pair<std::string, NamedView>> choices;
  for (const bool has_world : {true, false}) {
    for (const view::NamedViewRow& row : view::NamedViewTable()) {
      if (row.has_world() == has_world) {
        choices.emplace_back(row.name, row.named_view);
      }
    }
  }
  return ParseChoice<NamedView>(text, choices);
}

absl::StatusOr<v1::CameraFit> ParseFit(absl::string_view text) {
  return ParseChoice<v1::CameraFit>(text, {{"volume", v1::CAMERA_FIT_VOLUME},
                                           {"surface", v1::CAMERA_FIT_SURFACE},
                                           {"cells", v1::CAMERA_FIT_CELLS}});
}

// Returns the first flag that places or rotates the eye; null if there is none.
const char* FirstPlaced(const CameraFlags& camera) {
  return camera.eye             ? "--eye"
         : camera.target        ? "--target"
         : camera.up            ? "--up"
         : camera.fov_y_degrees ? "--fov-y"
                                : nullptr;
}
const char* FirstTurned(const CameraFlags& camera) {
  return camera.azimuth_degrees     ? "--azimuth"
         : camera.elevation_degrees ? "--elevation"
         : camera.zoom              ? "--zoom"
                                    : nullptr;
}

// Where a volume lies.
struct Place {
  math::Box3d bounds;
  std::optional<volume::PatientFrame> patient_frame;
};

absl::StatusOr<Place> PlaceOf(const v1::Dataset& dataset) {
  ISOSCOPE_ASSIGN_OR_RETURN(const volume::GridGeometry geometry,
                            wire::GeometryFromProto(dataset.geometry(), "dataset.geometry"));
  Place place{.bounds = geometry.Bounds(), .patient_frame = std::nullopt};
  if (!dataset.patient_frame().empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(place.patient_frame,
                              volume::PatientFrame::FromName(dataset.patient_frame()));
  }
  return place;
}

const char* NameOfFit(const ViewFlags& flags) {
  return flags.fit == v1::CAMERA_FIT_CELLS ? "--fit cells" : "--fit surface";
}

}  // namespace

void AddNamedViewFlags(cli::FlagSet* set, ViewFlags* flags) {
  const auto add = [&](cli::Flag flag) { flag.Group(kGroup); };
  add(cli::AddFlag(
      set, "--view", "NAME", &flags->view, ParseView,
      "look from a side: front (from +z, +y up; the default if another flag of the camera is "
      "given), back, left (-x), right (+x), "
      "top (+y), bottom; where the patient is known (NIfTI, DICOM, NRRD with a space): "
      "anterior, posterior, superior, inferior, and left and right are the patient's; "
      "--azimuth, --elevation, --zoom turn on from there"));
  add(cli::AddFlag(
      set, "--fit", "volume|surface|cells", &flags->fit, ParseFit,
      "what the picture frames: the whole volume (the default if another flag of the camera is "
      "given), the blocks that the surface meets, where nothing clips them, or its cells, tightly, "
      "however the volume is cut"));
}

void AddViewFlags(cli::FlagSet* set, ViewFlags* flags) {
  const auto add = [&](cli::Flag flag) { flag.Group(kGroup); };
  AddNamedViewFlags(set, flags);
  add(cli::AddFlag(set, "--camera", "FILE.json", &flags->camera_file, cli::ParseText,
                   "the camera that --save-camera wrote; not with other flags of the camera"));
  add(cli::AddFlag(set, "--save-camera", "FILE.json", &flags->save_camera_file, cli::ParseText,
                   "write the camera of the first frame"));
}

absl::Status CheckUsage(const ViewFlags& flags, const CameraFlags& camera) {
  const char* placed = FirstPlaced(camera);
  const char* turned = FirstTurned(camera);
  const char* other = placed != nullptr      ? placed
                      : turned != nullptr    ? turned
                      : flags.view           ? "--view"
                      : flags.fits_surface() ? NameOfFit(flags)
                                             : nullptr;
  if (camera.orthographic_height && (flags.camera_file || flags.fits_surface())) {
    return cli::UsageError(absl::StrCat("--orthographic-height can't be used with ",
                                        flags.camera_file ? "--camera" : NameOfFit(flags),
                                        ", which sets the height of the view"));
  }
  if (flags.camera_file && other != nullptr) {
    return cli::UsageError(
        absl::StrCat("--camera can't be used with ", other, ": the file has the whole camera"));
  }
  if (placed != nullptr && (flags.view || flags.fits_surface())) {
    return cli::UsageError(
        absl::StrCat(placed, " can't be used with ", flags.view ? "--view" : NameOfFit(flags),
                     ", which places the camera; --azimuth, --elevation and --zoom "
                     "can"));
  }
  return absl::OkStatus();
}

bool HasCamera(const ViewFlags& flags, const CameraFlags& camera) {
  return flags.view || flags.fit || flags.camera_file || FirstPlaced(camera) != nullptr ||
         FirstTurned(camera) != nullptr || camera.orthographic_height;
}

absl::StatusOr<v1::Camera> ResolveView(const ViewFlags& flags, const CameraFlags& camera,
                                       const v1::Dataset& dataset) {
  if (flags.camera_file) {
    return ReadCameraFile(*flags.camera_file);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const Place place, PlaceOf(dataset));
  ISOSCOPE_ASSIGN_OR_RETURN(const view::Camera start,
                            view::MakeNamedCamera(flags.view.value_or(NamedView::kFront),
                                                  place.bounds, place.patient_frame));
  ISOSCOPE_ASSIGN_OR_RETURN(const view::Camera resolved, ResolveCamera(camera, start));
  return wire::ToProto(resolved);
}

absl::StatusOr<v1::Camera> FirstLookCamera(const v1::Dataset& dataset) {
  ISOSCOPE_ASSIGN_OR_RETURN(const Place place, PlaceOf(dataset));
  return wire::ToProto(wire::FirstLookCamera(place.bounds, place.patient_frame));
}

}  // namespace isoscope::client
