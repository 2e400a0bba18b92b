// The file of a film: the answers to like requests as one animation.

#ifndef ISOSCOPE_CLIENTS_CPP_CONNECTION_FILM_FILE_H_
#define ISOSCOPE_CLIENTS_CPP_CONNECTION_FILM_FILE_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"

#include "clients/cpp/picture_file/animation_writer.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::client {

// Creates an animation of pictures that have the size and the background of `request`. REQUIRES and
// errors as CreateAnimation.
absl::StatusOr<std::unique_ptr<AnimationWriter>> CreateFilm(
    const std::string& path, const isoscope::v1::RenderIsosurfaceRequest& request, int frame_count,
    double fps);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_CONNECTION_FILM_FILE_H_
