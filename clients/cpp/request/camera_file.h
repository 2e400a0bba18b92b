// A camera as a JSON file, which users may write by hand:
//
//   {
//     "eye": [0, 0, 500],
//     "target": [0, 0, 0],
//     "up": [0, 1, 0],
//     "perspective": {"fov_y_degrees": 30}
//   }
//
// The members are those of the message Camera; "up" is optional. "orthographic": {"height": 200}
// may replace "perspective". Reading restores the bits of the written numbers.

#ifndef ISOSCOPE_CLIENTS_CPP_REQUEST_CAMERA_FILE_H_
#define ISOSCOPE_CLIENTS_CPP_REQUEST_CAMERA_FILE_H_

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "isoscope/v1/geometry.pb.h"

namespace isoscope::client {

std::string CameraToJson(const isoscope::v1::Camera& camera);
// INVALID_ARGUMENT names `where`, the member and the expected value: no JSON object, a member that
// is missing, unknown or of another type, or an invalid camera.
absl::StatusOr<isoscope::v1::Camera> CameraFromJson(absl::string_view text,
                                                    absl::string_view where);

// Reads a file of at most 64 KiB. NOT_FOUND and other errors of reading; as CameraFromJson.
absl::StatusOr<isoscope::v1::Camera> ReadCameraFile(const std::string& path);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_REQUEST_CAMERA_FILE_H_
