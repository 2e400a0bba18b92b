// isoscope-example HOST:PORT ISOVALUE SECONDS CA.pem TOKEN_FILE ("" for plaintext, "" for no token)
#include <cstdlib>
#include <fstream>
#include <iostream>

#include "clients/cpp/connection/connect.h"
#include "clients/cpp/connection/mesh_export.h"
#include "clients/cpp/connection/render_frame.h"
#include "clients/cpp/request/render_request.h"
#include "clients/cpp/request/view_flags.h"
#include "core/base/status_macros.h"
#include "isoscope/v1/dataset.pb.h"

using namespace isoscope;

absl::Status Run(const client::ConnectOptions& server, double isovalue, absl::Duration timeout,
                 cli::Interrupt* interrupt) {
  ISOSCOPE_ASSIGN_OR_RETURN(const auto service, client::Connect(server, interrupt));
  ISOSCOPE_ASSIGN_OR_RETURN(const v1::Dataset head, service->GetDataset("", timeout));

  const client::RequestFlags flags{.isovalue = isovalue, .width = 400, .height = 300};
  ISOSCOPE_ASSIGN_OR_RETURN(const v1::Camera camera,
                            client::ResolveView({}, {.azimuth_degrees = 30}, head));
  ISOSCOPE_ASSIGN_OR_RETURN(auto request, client::MakeRequest(flags, head.name(), camera));
  const client::PlaneFiles planes{.depth = "depth.npy"};
  client::RequestPlanes(planes, request.mutable_output());
  ISOSCOPE_ASSIGN_OR_RETURN(const auto frame, client::RenderFrame(request, timeout, service.get()));
  std::ofstream("head.png", std::ios::binary) << frame.png();
  ISOSCOPE_RETURN_IF_ERROR(client::WritePlanes(planes, frame));
  std::cout << frame.statistics().DebugString();

  v1::ExportIsosurfaceRequest surface;
  surface.set_dataset(head.name());
  surface.set_isovalue(isovalue);
  ISOSCOPE_ASSIGN_OR_RETURN(const auto mesh,
                            client::WriteMeshFile(surface, "head.glb", timeout, service.get()));
  std::cout << "head.glb: " << mesh.triangle_count << " triangles\n";
  return absl::OkStatus();
}

int main(int argc, char** argv) {
  static cli::Interrupt interrupt;
  interrupt.InstallForProcess();  // Ctrl-C ends the calls
  if (argc != 6) return 2;
  const absl::Status status =
      Run({.address = argv[1], .transport = {.ca_file = argv[4]}, .token_file = argv[5]},
          std::atof(argv[2]), absl::Seconds(std::atof(argv[3])), &interrupt);
  if (status.ok()) return 0;
  std::cerr << absl::StatusCodeToString(status.code()) << ": " << status.message() << "\n";
  return 1;
}
