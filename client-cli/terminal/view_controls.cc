// The picture follows the key, so the camera moves in the opposite direction:
//
//   arrows        turn the eye about the target by 5 degrees
//   Shift arrows  move eye and target by a twentieth of the picture's height
//   + -           change the distance by a factor of 1.15, within 0.001 and 100 radii of the volume
//   , .           roll the up vector by 5 degrees
//   [ ]           move the isovalue to a multiple of its step: 1, 2 or 5 times a power of ten
//   n N           show the next, the previous label alone; behind the last one, all
//   x d a         hide the label, dim the others, show all (label_choice)
//
// For values of 0 to 255 the step is 2, so [ leads from 100 to 98. `1` to `6` count the named views
// that the volume has: those of the patient if it knows one, else those of the world.

#include "client-cli/terminal/view_controls.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>

#include "absl/status/statusor.h"

#include "core/math/vec.h"
#include "core/view/camera_fit.h"

namespace isoscope::cli {
namespace {

constexpr double kTurn = 5 * std::numbers::pi / 180;
constexpr double kZoom = 1.15;
constexpr double kPan = 0.05;  // of the height of the picture
constexpr int kLargeSteps = 10;
// The eye stays between these multiples of the volume's radius.
constexpr double kNearest = 1e-3;
constexpr double kFarthest = 100;

}  // namespace

double IsovalueStep(const volume::ScalarSpan& values) {
  const double hundredth = values.max / 100 - values.min / 100;
  if (!(hundredth > 0) || !std::isfinite(hundredth)) {
    return 1;
  }
  const double power = std::pow(10, std::floor(std::log10(hundredth)));
  return hundredth >= 5 * power ? 5 * power : hundredth >= 2 * power ? 2 * power : power;
}

ViewControls::ViewControls(const ViewedVolume& volume, std::optional<double> isovalue,
                           std::size_t label_count)
    : volume_(volume),
      first_isovalue_(isovalue),
      isovalue_step_(IsovalueStep(volume.values)),
      camera_(volume.first_camera.value_or(view::MakeDefaultCamera(volume.bounds))),
      isovalue_(isovalue),
      labels_(label_count, /*shows_others=*/isovalue.has_value()) {}

void ViewControls::LookFrom(int view) {
  int left = view;
  for (const view::NamedViewRow& row : view::NamedViewTable()) {
    const bool has_key = volume_.patient_frame ? row.has_patient() : row.has_world();
    if (!has_key || left-- > 0) {
      continue;
    }
    const absl::StatusOr<view::Camera> camera =
        view::MakeNamedCamera(row.named_view, volume_.bounds, volume_.patient_frame);
    if (camera.ok()) {
      camera_ = *camera;
    }
    return;
  }
}

void ViewControls::Zoom(double factor) {
  const math::Vec3d to_eye = (camera_.eye - camera_.target) * (1 / factor);
  const double radius = volume_.bounds.Radius() > 0 ? volume_.bounds.Radius() : 0.5;
  const double distance = math::Length(to_eye);
  if (distance > kNearest * radius && distance < kFarthest * radius) {
    camera_.eye = camera_.target + to_eye;
  }
}

void ViewControls::Pan(double right, double up) {
  const math::Vec3d forward = camera_.target - camera_.eye;
  const double height = 2 * math::Length(forward) * std::tan(camera_.fov_y_radians / 2);
  const math::Vec3d right_axis = math::Normalized(math::Cross(forward, camera_.up));
  const math::Vec3d up_axis = math::Normalized(math::Cross(right_axis, forward));
  // The scene follows the key, so the eye moves in the opposite direction.
  const math::Vec3d move = right_axis * (-right * height) + up_axis * (-up * height);
  camera_.eye = camera_.eye + move;
  camera_.target = camera_.target + move;
}

void ViewControls::Roll(double radians) {
  const math::Vec3d forward = math::Normalized(camera_.target - camera_.eye);
  camera_.up = math::Normalized(camera_.up * std::cos(radians) +
                                math::Cross(forward, camera_.up) * std::sin(radians));
}

bool ViewControls::MoveIsovalue(int steps) {
  if (!isovalue_) {
    return false;
  }
  // A multiple of the step, so that values stay round.
  const double next = (std::round(*isovalue_ / isovalue_step_) + steps) * isovalue_step_;
  isovalue_ = volume_.values.min < volume_.values.max
                  ? std::clamp(next, volume_.values.min, volume_.values.max)
                  : next;
  return true;
}

bool ViewControls::PressSurfaceKey(char character) {
  switch (character) {
    case '[':
    case ']':
      return MoveIsovalue(character == ']' ? 1 : -1);
    case '{':
    case '}':
      return MoveIsovalue(character == '}' ? kLargeSteps : -kLargeSteps);
    case 'n':
    case 'N':
      return labels_.Step(character == 'n');
    case 'x':
      return labels_.ToggleHidden();
    case 'd':
      return labels_.ToggleHighlight();
    case 'a':
      return labels_.ShowAll();
    default:
      return false;
  }
}

bool ViewControls::PressArrow(const Key& key) {
  const bool is_sideways = key.kind == Key::Kind::kLeft || key.kind == Key::Kind::kRight;
  const double sign = key.kind == Key::Kind::kRight || key.kind == Key::Kind::kUp ? 1 : -1;
  if (key.has_shift) {
    Pan(is_sideways ? sign * kPan : 0, is_sideways ? 0 : sign * kPan);
  } else if (is_sideways) {
    view::Azimuth(-sign * kTurn, &camera_);
  } else {
    view::Elevation(-sign * kTurn, &camera_);
    view::OrthogonalizeUp(&camera_);
  }
  return true;
}

bool ViewControls::PressCharacter(char character) {
  const auto arrow = [&](Key::Kind kind, bool has_shift) {
    return PressArrow({.kind = kind, .character = 0, .has_shift = has_shift});
  };
  switch (character) {
    case 'h':
    case 'H':
      return arrow(Key::Kind::kLeft, character == 'H');
    case 'j':
    case 'J':
      return arrow(Key::Kind::kDown, character == 'J');
    case 'k':
    case 'K':
      return arrow(Key::Kind::kUp, character == 'K');
    case 'l':
    case 'L':
      return arrow(Key::Kind::kRight, character == 'L');
    case '+':
    case '=':
      Zoom(kZoom);
      return true;
    case '-':
      Zoom(1 / kZoom);
      return true;
    case ',':
      Roll(kTurn);
      return true;
    case '.':
      Roll(-kTurn);
      return true;
    default:
      break;
  }
  if (character >= '1' && character <= '6') {
    LookFrom(character - '1');
    return true;
  }
  return PressSurfaceKey(character);
}

ViewControls::Effect ViewControls::ResetCamera() {
  camera_ = volume_.first_camera.value_or(view::MakeDefaultCamera(volume_.bounds));
  return Effect::kReset;
}

ViewControls::Effect ViewControls::Press(const Key& key) {
  if (key.kind == Key::Kind::kHome) {
    return ResetCamera();
  }
  if (key.kind != Key::Kind::kCharacter) {
    return PressArrow(key) ? Effect::kMoved : Effect::kNone;
  }
  if (key.character == 'q' || key.character == 'Q') {
    return Effect::kQuit;
  }
  if (key.character == '?') {
    return Effect::kHelp;
  }
  if (key.character == '0' || key.character == 'r') {
    isovalue_ = first_isovalue_;
    labels_.ShowAll();
    return ResetCamera();
  }
  return PressCharacter(key.character) ? Effect::kMoved : Effect::kNone;
}

std::string DescribeKeys() {
  return "arrows, h j k l        turn by 5 degrees\n"
         "Shift and those        move\n"
         "+ -                    zoom\n"
         ", .                    roll\n"
         "[ ]                    lower, raise the isovalue; { } ten times as far\n"
         "n N                    the next, the previous label alone; a all\n"
         "x d                    hide it; dim the others; again: no more\n"
         "1 2 3 4 5 6            front back left right top bottom\n"
         "                       (of the patient where the file knows one)\n"
         "r 0                    back to the first view, isovalue and labels\n"
         "?                      this help; any key closes it\n"
         "q Ctrl-C               quit\n";
}

}  // namespace isoscope::cli
