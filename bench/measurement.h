// The common parts of all measurements: the machine and the date, the scene of the frames, the
// agents that draw them, and the report as JSON and as text.

#ifndef ISOSCOPE_BENCH_MEASUREMENT_H_
#define ISOSCOPE_BENCH_MEASUREMENT_H_

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include <nlohmann/json_fwd.hpp>

#include "bench/machine.h"
#include "client-cli/session/session.h"
#include "clients/cpp/connection/service_client.h"
#include "clients/cpp/request/render_request.h"
#include "core/cli/command.h"
#include "core/view/view.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::bench {

// The default camera of measurements, in degrees.
inline constexpr double kDefaultAzimuth = 30;
inline constexpr double kDefaultElevation = 20;

// The circumstances of a measurement.
struct Occasion {
  Machine machine = {};
  std::string date = {};    // of Timestamp
  std::string volume = {};  // its file, folder or dataset, by name
};

// The agents that draw the frames.
struct Drawers {
  int agent_count = 0;
  std::string renderer;  // of the first agent
};

// A dataset, its camera, and the flags of its frames.
struct Scene {
  client::RequestFlags flags;
  std::string dataset;
  view::Camera camera;

  // Returns the frame whose camera is rotated `turn_count` times by `degrees` about up.
  [[nodiscard]] isoscope::v1::RenderIsosurfaceRequest Frame(double degrees = 0,
                                                            int turn_count = 0) const;
};

// Requests the dataset of that name, "" for the only one. Errors of GetDataset and of the camera.
absl::StatusOr<Scene> FindScene(const client::RequestFlags& flags, const std::string& dataset,
                                client::ServiceClient* client);

// A server, or coordinator and agents in this process, with their scene.
struct Stage {
  std::unique_ptr<cli::Session> session;
  Scene scene;
  Drawers drawers;
};
// Errors of Session::Open, of FindScene and of GetClusterStatus.
absl::StatusOr<Stage> OpenStage(const cli::SessionFlags& session, const client::RequestFlags& flags,
                                const cli::Context& context);

// Returns {"machine", "date"}, the first members of every measurement's JSON.
nlohmann::ordered_json JsonHead(const Occasion& occasion);
// Appends {"width", "height"}.
void AddSize(const client::RequestFlags& flags, nlohmann::ordered_json* json);
// Appends {"width", "height", "agents", "renderer"}.
void AddFrame(const client::RequestFlags& flags, const Drawers& drawers,
              nlohmann::ordered_json* json);

// Returns "1024 x 768 pixels, 1 agent", with "s" for several.
std::string DescribeFrame(const client::RequestFlags& flags, const Drawers& drawers);

// Returns the name of a session's volume in JSON: its file or folder, else the dataset.
std::string VolumeOf(const cli::SessionFlags& session);

struct Report {
  std::string json;
  std::string text;
};
// Measures and writes the report. The JSON goes to `json_path`, if there is one, after a check
// before the measurement that it is writable. The text follows a line of machine and date.
absl::Status RunMeasurement(
    const std::optional<std::string>& json_path, absl::string_view volume,
    const cli::Context& context,
    const std::function<absl::StatusOr<Report>(const Occasion& occasion)>& measure);

}  // namespace isoscope::bench

#endif  // ISOSCOPE_BENCH_MEASUREMENT_H_
