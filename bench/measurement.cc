#include "bench/measurement.h"

#include <filesystem>
#include <ostream>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include <nlohmann/json.hpp>

#include "clients/cpp/request/camera_flags.h"
#include "core/base/status_macros.h"
#include "core/io/atomic_file.h"
#include "isoscope/v1/cluster_service.pb.h"
#include "isoscope/v1/dataset.pb.h"
#include "wire/proto_convert.h"

namespace isoscope::bench {
namespace {

namespace v1 = isoscope::v1;

constexpr absl::Duration kMaxWait = absl::Minutes(1);

}  // namespace

v1::RenderIsosurfaceRequest Scene::Frame(double degrees, int turn_count) const {
  return client::MakeRequest(flags, dataset, client::OrbitCamera(camera, degrees, turn_count));
}

absl::StatusOr<Scene> FindScene(const client::RequestFlags& flags, const std::string& dataset,
                                client::ServiceClient* client) {
  ISOSCOPE_ASSIGN_OR_RETURN(const v1::Dataset found, client->GetDataset(dataset, kMaxWait));
  ISOSCOPE_ASSIGN_OR_RETURN(const volume::GridGeometry geometry,
                            wire::GeometryFromProto(found.geometry(), "dataset.geometry"));
  Scene scene{.flags = flags, .dataset = found.name(), .camera = {}};
  ISOSCOPE_ASSIGN_OR_RETURN(scene.camera, client::ResolveCamera(flags.camera, geometry.Bounds()));
  return scene;
}

absl::StatusOr<Stage> OpenStage(const cli::SessionFlags& session, const client::RequestFlags& flags,
                                const cli::Context& context) {
  Stage stage;
  ISOSCOPE_ASSIGN_OR_RETURN(stage.session,
                            cli::Session::Open(session, nullptr, flags.viewport(), context));
  client::ServiceClient& client = stage.session->client();
  ISOSCOPE_ASSIGN_OR_RETURN(stage.scene, FindScene(flags, stage.session->dataset_name(), &client));
  ISOSCOPE_ASSIGN_OR_RETURN(const v1::GetClusterStatusResponse cluster,
                            client.GetClusterStatus(kMaxWait));
  stage.drawers = {cluster.agents_size(),
                   cluster.agents().empty() ? "" : cluster.agents(0).renderer()};
  return stage;
}

nlohmann::ordered_json JsonHead(const Occasion& occasion) {
  return {{"machine", ToString(occasion.machine)}, {"date", occasion.date}};
}

void AddSize(const client::RequestFlags& flags, nlohmann::ordered_json* json) {
  (*json)["width"] = flags.viewport().width_px;
  (*json)["height"] = flags.viewport().height_px;
}

void AddFrame(const client::RequestFlags& flags, const Drawers& drawers,
              nlohmann::ordered_json* json) {
  AddSize(flags, json);
  (*json)["agents"] = drawers.agent_count;
  (*json)["renderer"] = drawers.renderer;
}

std::string DescribeFrame(const client::RequestFlags& flags, const Drawers& drawers) {
  return absl::StrCat(flags.viewport().width_px, " x ", flags.viewport().height_px, " pixels, ",
                      drawers.agent_count, drawers.agent_count == 1 ? " agent" : " agents");
}

std::string VolumeOf(const cli::SessionFlags& session) {
  return std::filesystem::path(session.input.value_or(session.dataset.value_or("")))
      .filename()
      .string();
}

absl::Status RunMeasurement(
    const std::optional<std::string>& json_path, absl::string_view volume,
    const cli::Context& context,
    const std::function<absl::StatusOr<Report>(const Occasion& occasion)>& measure) {
  if (json_path) {
    ISOSCOPE_RETURN_IF_ERROR(io::CheckWritable(*json_path));
  }
  const Occasion occasion{
      .machine = DescribeMachine(), .date = Timestamp(), .volume = std::string(volume)};
  ISOSCOPE_ASSIGN_OR_RETURN(const Report report, measure(occasion));
  if (json_path) {
    ISOSCOPE_RETURN_IF_ERROR(io::WriteFileAtomically(*json_path, report.json));
  }
  *context.out << ToString(occasion.machine) << "; " << occasion.date << "\n" << report.text;
  return absl::OkStatus();
}

}  // namespace isoscope::bench
