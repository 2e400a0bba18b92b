// The picture of an answer: the requests that can be answered, how long an answer may be cached,
// and the answer itself. No I/O.

#ifndef ISOSCOPE_WEB_GATEWAY_API_PICTURE_ANSWER_H_
#define ISOSCOPE_WEB_GATEWAY_API_PICTURE_ANSWER_H_

#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

#include "isoscope/v1/dataset_service.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "web-gateway/http/http_message.h"

namespace isoscope::gateway {

// INVALID_ARGUMENT if an answer over HTTP can't hold what the request asks for: it is one picture,
// or one plane.
absl::Status CheckAnswerable(const isoscope::v1::RenderIsosurfaceRequest& request);

struct PictureCaching {
  std::string etag;  // empty: no cache may keep the picture
  std::vector<std::pair<std::string, std::string>> headers;
};
// Completes the selection of the request by what `dataset` serves, and returns how its picture may
// be cached: not without a picture revision. `is_by_id`: the address names the content of the
// dataset. `is_private`: no shared cache may keep it. `extras_key`: of what the gateway adds to the
// picture (picture_extras.h); with one the picture is never immutable.
PictureCaching CachingOf(const isoscope::v1::Dataset& dataset, absl::string_view picture_revision,
                         bool is_by_id, bool is_private, absl::string_view extras_key,
                         isoscope::v1::RenderIsosurfaceRequest* request);

// Returns the picture or plane that the request asks for, with these headers and those of the
// frame.
HttpResponse PictureResponse(const isoscope::v1::RenderIsosurfaceRequest& request,
                             std::vector<std::pair<std::string, std::string>> headers,
                             isoscope::v1::RenderIsosurfaceResponse rendered);

// Makes the PNG of an answer a lossless WebP of the same pixels. Errors as client::WebpOfPng; then the
// answer is as before.
absl::Status ConvertToWebp(HttpResponse* picture);

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_API_PICTURE_ANSWER_H_
