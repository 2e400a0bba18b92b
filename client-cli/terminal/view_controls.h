// The keys of `view --terminal` and their effect on the view. The page has the same keys, but for
// labels, which it lists.

#ifndef ISOSCOPE_CLIENT_CLI_TERMINAL_VIEW_CONTROLS_H_
#define ISOSCOPE_CLIENT_CLI_TERMINAL_VIEW_CONTROLS_H_

#include <cstddef>
#include <optional>
#include <string>

#include "client-cli/terminal/label_choice.h"
#include "client-cli/terminal/terminal_keys.h"
#include "core/math/box.h"
#include "core/view/camera.h"
#include "core/volume/patient_frame.h"
#include "core/volume/scalar_span.h"

namespace isoscope::cli {

// The dataset on view.
struct ViewedVolume {
  math::Box3d bounds;
  std::optional<volume::PatientFrame> patient_frame;
  volume::ScalarSpan values;  // limits of isovalues; empty if no sample is a number
  // The camera to begin with; not set: the default one of `bounds`.
  std::optional<view::Camera> first_camera = std::nullopt;
};

// Thread-compatible.
class ViewControls {
 public:
  // label_count: of the surfaces of labels; all are shown at the beginning
  ViewControls(const ViewedVolume& volume, std::optional<double> isovalue,
               std::size_t label_count = 0);

  // kReset: the camera is that of the beginning.
  enum class Effect { kNone, kMoved, kReset, kHelp, kQuit };
  Effect Press(const Key& key);

  [[nodiscard]] const view::Camera& camera() const { return camera_; }
  // Takes the camera that the server has chosen. REQUIRES: it is valid.
  void SetCamera(const view::Camera& camera) { camera_ = camera; }
  // Not set: no surface has one.
  [[nodiscard]] std::optional<double> isovalue() const { return isovalue_; }
  // The surfaces of labels.
  [[nodiscard]] const LabelChoice& labels() const { return labels_; }

 private:
  bool PressArrow(const Key& key);
  bool PressCharacter(char character);
  void LookFrom(int view);
  Effect ResetCamera();
  void Zoom(double factor);
  void Pan(double right, double up);
  void Roll(double radians);
  bool PressSurfaceKey(char character);
  bool MoveIsovalue(int steps);

  const ViewedVolume volume_;
  const std::optional<double> first_isovalue_;
  const double isovalue_step_;
  view::Camera camera_;
  std::optional<double> isovalue_;
  LabelChoice labels_;
};

// The lines of the help, each at most 60 characters.
std::string DescribeKeys();

// Returns 1, 2 or 5 times a power of ten: between a hundredth and a third of a hundredth of the
// range, or 1 if the range is empty or not finite.
double IsovalueStep(const volume::ScalarSpan& values);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_TERMINAL_VIEW_CONTROLS_H_
