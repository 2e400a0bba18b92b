#include "clients/cpp/request/camera_file.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <initializer_list>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include <nlohmann/json.hpp>

#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "wire/proto_convert.h"

namespace isoscope::client {
namespace {

namespace v1 = isoscope::v1;
using Json = nlohmann::ordered_json;

constexpr std::int64_t kMaxFileBytes = 64 * base::kKiB;

Json ToJson(const v1::Vec3& vector) { return Json::array({vector.x(), vector.y(), vector.z()}); }

// Reads members of a camera. Each type is checked before it is read, so that the library never
// throws.
class CameraReader {
 public:
  explicit CameraReader(absl::string_view where) : where_(where) {}

  absl::StatusOr<v1::Camera> Read(const Json& json) const {
    ISOSCOPE_RETURN_IF_ERROR(
        CheckMembers(json, "", {"eye", "target", "up", "perspective", "orthographic"}));
    v1::Camera camera;
    ISOSCOPE_RETURN_IF_ERROR(ReadVector(json, "eye", camera.mutable_eye()));
    ISOSCOPE_RETURN_IF_ERROR(ReadVector(json, "target", camera.mutable_target()));
    if (json.contains("up")) {
      ISOSCOPE_RETURN_IF_ERROR(ReadVector(json, "up", camera.mutable_up()));
    }
    if (json.contains("perspective") == json.contains("orthographic")) {
      return Error("expected one of \"perspective\" and \"orthographic\"");
    }
    const bool is_perspective = json.contains("perspective");
    const char* kind = is_perspective ? "perspective" : "orthographic";
    const char* member = is_perspective ? "fov_y_degrees" : "height";
    const Json& projection = json.at(kind);
    ISOSCOPE_RETURN_IF_ERROR(CheckMembers(projection, kind, {member}));
    double value = 0;
    if (!projection.contains(member) || !ToNumber(projection.at(member), &value)) {
      return Error(absl::StrCat("\"", kind, ".", member, "\": expected a finite number"));
    }
    if (is_perspective) {
      camera.mutable_perspective()->set_fov_y_degrees(value);
    } else {
      camera.mutable_orthographic()->set_height(value);
    }
    const absl::Status valid = wire::CameraFromProto(camera, "camera").status();
    return valid.ok() ? absl::StatusOr<v1::Camera>(camera) : Error(valid.message());
  }

 private:
  [[nodiscard]] absl::Status Error(absl::string_view message) const {
    return absl::InvalidArgumentError(absl::StrCat(where_, ": ", message));
  }

  // Checks that `json` is an object without other members.
  absl::Status CheckMembers(const Json& json, absl::string_view name,
                            std::initializer_list<absl::string_view> known) const {
    if (!json.is_object()) {
      return Error(name.empty() ? "expected a JSON object"
                                : absl::StrCat("\"", name, "\": expected a JSON object"));
    }
    for (const auto& [key, value] : json.items()) {
      if (std::find(known.begin(), known.end(), absl::string_view(key)) == known.end()) {
        return Error(absl::StrCat("unknown member \"", key.substr(0, 40), "\"; expected ",
                                  absl::StrJoin(known, ", ")));
      }
    }
    return absl::OkStatus();
  }

  static bool ToNumber(const Json& json, double* value) {
    if (!json.is_number()) {
      return false;
    }
    *value = json.get<double>();
    return std::isfinite(*value);
  }

  absl::Status ReadVector(const Json& json, const char* name, v1::Vec3* vector) const {
    double values[3] = {};
    bool is_good = json.contains(name) && json.at(name).is_array() && json.at(name).size() == 3;
    for (std::size_t i = 0; is_good && i < 3; ++i) {
      is_good = ToNumber(json.at(name).at(i), values + i);
    }
    if (!is_good) {
      return Error(absl::StrCat("\"", name, "\": expected three finite numbers, [X, Y, Z]"));
    }
    vector->set_x(values[0]);
    vector->set_y(values[1]);
    vector->set_z(values[2]);
    return absl::OkStatus();
  }

  const absl::string_view where_;
};

}  // namespace

std::string CameraToJson(const v1::Camera& camera) {
  Json json;
  json["eye"] = ToJson(camera.eye());
  json["target"] = ToJson(camera.target());
  if (camera.has_up()) {
    json["up"] = ToJson(camera.up());
  }
  if (camera.has_orthographic()) {
    json["orthographic"] = {{"height", camera.orthographic().height()}};
  } else {
    json["perspective"] = {{"fov_y_degrees", camera.perspective().fov_y_degrees()}};
  }
  return json.dump(2) + "\n";
}

absl::StatusOr<v1::Camera> CameraFromJson(absl::string_view text, absl::string_view where) {
  const Json json =
      Json::parse(text.begin(), text.end(), /*cb=*/nullptr, /*allow_exceptions=*/false);
  if (json.is_discarded()) {
    return absl::InvalidArgumentError(absl::StrCat(where, ": no valid JSON"));
  }
  return CameraReader(where).Read(json);
}

absl::StatusOr<v1::Camera> ReadCameraFile(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const auto file, io::OpenRandomAccessFile(path));
  if (file->size_bytes() > kMaxFileBytes) {
    return absl::InvalidArgumentError(absl::StrCat(
        path, ": ", file->size_bytes(), " bytes, more than any camera has (", kMaxFileBytes, ")"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string text, io::ReadWholeFile(*file, kMaxFileBytes));
  return CameraFromJson(text, path);
}

}  // namespace isoscope::client
