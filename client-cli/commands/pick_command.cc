// isoscope pick INPUT | DIR | --server HOST:PORT --isovalue V --pixel X,Y
//
// A pick draws the frame that `render` would draw with the same flags, also the first look without
// flags of the camera, and returns the surface
// point at each pixel. So --region is removed: pixels refer to the whole picture. --json prints one
// object a pixel with the names of the API.

#include <algorithm>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include <nlohmann/json.hpp>

#include "client-cli/commands/program.h"
#include "client-cli/commands/surface_notes.h"
#include "client-cli/session/session.h"
#include "clients/cpp/connection/features.h"
#include "clients/cpp/connection/label_query.h"
#include "clients/cpp/connection/service_client.h"
#include "clients/cpp/request/camera_file.h"
#include "clients/cpp/request/dataset_fields.h"
#include "clients/cpp/request/render_request.h"
#include "clients/cpp/request/view_flags.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/cli/format.h"
#include "core/cli/table.h"
#include "core/cli/usage.h"
#include "core/cli/waiting_line.h"
#include "core/io/atomic_file.h"
#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "wire/pick_convert.h"

namespace isoscope::cli {
namespace {

namespace v1 = isoscope::v1;

struct PickFlags {
  SessionFlags session;
  client::RequestFlags request;
  client::ViewFlags view;
  std::vector<std::string> pixels;
  bool is_json = false;
  bool all_fields = false;
};

// "X,Y", inside the viewport.
absl::StatusOr<wire::PixelPosition> ParsePixel(absl::string_view text,
                                               const view::Viewport& viewport) {
  const std::vector<absl::string_view> elements = absl::StrSplit(text, ',');
  wire::PixelPosition pixel;
  if (elements.size() != 2 || !absl::SimpleAtoi(elements[0], &pixel.x) ||
      !absl::SimpleAtoi(elements[1], &pixel.y) || pixel.x < 0 || pixel.y < 0 ||
      pixel.x >= viewport.width_px || pixel.y >= viewport.height_px) {
    return UsageError(absl::StrCat("--pixel '", text, "' is not X,Y, a column from 0 to ",
                                   viewport.width_px - 1, " and a row from 0 to ",
                                   viewport.height_px - 1));
  }
  return pixel;
}

absl::Status CheckUsage(const PickFlags& flags) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.session));
  const client::RequestFlags& request = flags.request;
  if (!request.isovalue && request.surfaces.empty() && request.label.empty()) {
    ISOSCOPE_RETURN_IF_ERROR(CheckInputExists(flags.session));
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(request));
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.view, request.camera));
  if (flags.pixels.empty() || flags.pixels.size() > wire::kMaxPickedPixels) {
    return UsageError(absl::StrCat("--pixel X,Y is given ", flags.pixels.size(),
                                   " times: once for each pixel, 1 to ", wire::kMaxPickedPixels));
  }
  for (const std::string& text : flags.pixels) {
    ISOSCOPE_RETURN_IF_ERROR(ParsePixel(text, flags.request.viewport()).status());
  }
  return absl::OkStatus();
}

nlohmann::ordered_json ToJson(const v1::Vec3& v) { return {v.x(), v.y(), v.z()}; }

std::string ToText(const v1::Vec3& v) {
  return absl::StrFormat("%.7g,%.7g,%.7g", v.x(), v.y(), v.z());
}

// With all digits: far from the origin the last ones tell points apart.
std::string PositionText(const v1::Vec3& v) {
  return absl::StrCat(FormatCoordinate(v.x()), ",", FormatCoordinate(v.y()), ",",
                      FormatCoordinate(v.z()));
}

std::string DescribeAsJson(const v1::PickSurfaceRequest& request,
                           const v1::PickSurfaceResponse& response) {
  nlohmann::ordered_json json;
  json["points"] = nlohmann::ordered_json::array();
  for (int i = 0; i < response.points_size(); ++i) {
    const v1::PickedPoint& point = response.points(i);
    nlohmann::ordered_json out;
    out["pixel"] = {request.pixels(i).x(), request.pixels(i).y()};
    out["is_hit"] = point.is_hit();
    if (point.is_hit()) {
      out["position"] = ToJson(point.position());
      out["depth"] = point.depth();
      out["surface_index"] = point.surface_index();
      if (point.has_label()) {
        out["label"] = point.label();
        out["label_name"] = point.label_name();
      }
      if (point.has_normal()) {
        out["normal"] = ToJson(point.normal());
      }
      if (point.has_gradient()) {
        out["gradient"] = ToJson(point.gradient());
      }
      out["block_id"] = point.block_id();
      if (point.has_shard_index()) {
        out["shard_index"] = point.shard_index();
      }
      for (const v1::FieldValue& value : point.field_values()) {
        out["field_values"].push_back({{"field", value.field()},
                                       {"component", value.component()},
                                       {"unit", value.unit()},
                                       {"value", value.value()}});
      }
    }
    json["points"].push_back(std::move(out));
  }
  return json.dump(2) + "\n";
}

std::string DescribeAsTable(const v1::PickSurfaceRequest& request,
                            const v1::PickSurfaceResponse& response, int max_width) {
  Table table({"pixel", "position", "depth", "surface", "normal", "gradient", "block", "shard"});
  for (int i = 0; i < response.points_size(); ++i) {
    const v1::PickedPoint& point = response.points(i);
    const std::string pixel = absl::StrCat(request.pixels(i).x(), ",", request.pixels(i).y());
    if (!point.is_hit()) {
      table.AddRow({pixel, "-", "-", "-", "-", "-", "-", "-"});
      continue;
    }
    table.AddRow(
        {pixel, PositionText(point.position()),
         FormatCoordinate(static_cast<double>(point.depth())), absl::StrCat(point.surface_index()),
         point.has_normal() ? ToText(point.normal()) : "-",
         point.has_gradient() ? ToText(point.gradient()) : "-", absl::StrCat(point.block_id()),
         point.has_shard_index() ? absl::StrCat(point.shard_index()) : "-"});
  }
  return table.ToString(max_width);
}

// The labels at the points, one a row; "" if no surface has labels.
std::string DescribeLabelsOf(const v1::PickSurfaceRequest& request,
                             const v1::PickSurfaceResponse& response, int max_width) {
  Table table({"pixel", "label", "name"});
  bool has_labels = false;
  for (int i = 0; i < response.points_size(); ++i) {
    const v1::PickedPoint& point = response.points(i);
    if (point.has_label()) {
      has_labels = true;
      table.AddRow({absl::StrCat(request.pixels(i).x(), ",", request.pixels(i).y()),
                    FormatValue(point.label()),
                    point.label_name().empty() ? "-" : base::Printable(point.label_name())});
    }
  }
  return has_labels ? absl::StrCat("\n", table.ToString(max_width)) : "";
}

// The values of all fields, one a row; "" if there are none.
std::string DescribeValues(const v1::PickSurfaceRequest& request,
                           const v1::PickSurfaceResponse& response, int max_width) {
  Table table({"pixel", "field", "value", "unit"});
  bool has_values = false;
  for (int i = 0; i < response.points_size(); ++i) {
    for (const v1::FieldValue& value : response.points(i).field_values()) {
      has_values = true;
      table.AddRow({absl::StrCat(request.pixels(i).x(), ",", request.pixels(i).y()),
                    value.component().empty() ? value.field()
                                              : absl::StrCat(value.field(), ":", value.component()),
                    absl::StrFormat("%.7g", value.value()),
                    value.unit().empty() ? "-" : value.unit()});
    }
  }
  return has_values ? absl::StrCat("\n", table.ToString(max_width)) : "";
}

// Tells why surfaces do not show, unless the pixels show all of them.
absl::Status WriteNotesOnUnpicked(const v1::PickSurfaceRequest& request,
                                  const v1::PickSurfaceResponse& response, Session* session,
                                  const Context& context) {
  std::set<int> picked;
  for (const v1::PickedPoint& point : response.points()) {
    if (point.is_hit()) {
      picked.insert(point.surface_index());
    }
  }
  if (static_cast<int>(picked.size()) >= std::max(request.frame().surfaces_size(), 1)) {
    return absl::OkStatus();
  }
  return WriteNotesOf(
      request.frame(),
      [&](const v1::SurfaceNote& note) { return picked.count(note.surface_index()) == 0; }, session,
      context);
}

// The frame whose pixels are meant: that of `render` with the same flags.
absl::StatusOr<v1::RenderIsosurfaceRequest> MakeFrame(const PickFlags& flags,
                                                      const client::RequestFlags& frame_flags,
                                                      const v1::Dataset& dataset,
                                                      Session* session) {
  if (client::HasCamera(flags.view, flags.request.camera)) {
    ISOSCOPE_ASSIGN_OR_RETURN(const v1::Camera camera,
                              client::ResolveView(flags.view, flags.request.camera, dataset));
    return client::MakeRequest(frame_flags, dataset.name(), camera, flags.view.fit);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const v1::Camera camera, client::FirstLookCamera(dataset));
  ISOSCOPE_ASSIGN_OR_RETURN(
      v1::RenderIsosurfaceRequest request,
      client::MakeRequest(frame_flags, dataset.name(), camera, /*fit=*/std::nullopt));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const bool fits_cells,
      client::HasFeature("fit_cells", session->question_timeout(), &session->client()));
  if (fits_cells) {
    request.clear_camera();
    request.set_camera_fit(v1::CAMERA_FIT_CELLS);
  }
  return request;
}

absl::Status Run(const PickFlags& flags, const Context& context) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags));
  if (flags.view.save_camera_file) {
    ISOSCOPE_RETURN_IF_ERROR(io::CheckWritable(*flags.view.save_camera_file));
  }
  const WantedVolumes wanted{.selection = flags.request.selection,
                             .needs_all_fields = flags.all_fields};
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<Session> session,
                            Session::Open(flags.session, &wanted, std::nullopt, context));
  ISOSCOPE_ASSIGN_OR_RETURN(const v1::Dataset dataset, session->GetDataset());
  client::RequestFlags frame_flags = flags.request;
  session->AdaptSelection(&frame_flags.selection);
  ISOSCOPE_RETURN_IF_ERROR(client::ResolveNames(dataset, &frame_flags.selection));
  ISOSCOPE_RETURN_IF_ERROR(client::ResolveLabels(dataset, frame_flags.selection,
                                                 session->frame_timeout(), &session->client(),
                                                 &frame_flags.label));
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(frame_flags));
  v1::PickSurfaceRequest request;
  request.set_with_field_values(flags.all_fields);
  ISOSCOPE_ASSIGN_OR_RETURN(*request.mutable_frame(),
                            MakeFrame(flags, frame_flags, dataset, session.get()));
  for (const std::string& text : flags.pixels) {
    ISOSCOPE_ASSIGN_OR_RETURN(const wire::PixelPosition pixel,
                              ParsePixel(text, flags.request.viewport()));
    v1::Pixel* const out = request.add_pixels();
    out->set_x(pixel.x);
    out->set_y(pixel.y);
  }
  const auto pick = [&] {
    const WaitingLine waiting(context.err, context.err_is_terminal, "picking");
    return session->client().PickSurface(request, session->frame_timeout());
  };
  ISOSCOPE_ASSIGN_OR_RETURN(const v1::PickSurfaceResponse response, pick());
  if (response.points_size() != request.pixels_size()) {
    return absl::DataLossError(absl::StrCat("the server sent ", response.points_size(),
                                            " points for ", request.pixels_size(), " pixels"));
  }
  if (flags.view.save_camera_file) {
    ISOSCOPE_RETURN_IF_ERROR(io::WriteFileAtomically(*flags.view.save_camera_file,
                                                     client::CameraToJson(response.camera())));
  }
  if (flags.is_json) {
    *context.out << DescribeAsJson(request, response);
  } else {
    *context.out << DescribeAsTable(request, response, context.out_columns)
                 << DescribeLabelsOf(request, response, context.out_columns)
                 << DescribeValues(request, response, context.out_columns);
  }
  return WriteNotesOnUnpicked(request, response, session.get(), context);
}

Action RegisterPickFlags(FlagSet* set) {
  const auto flags = std::make_shared<PickFlags>();
  AddSessionFlags(set, &flags->session);
  AddRendererFlag(set, &flags->session);
  // One value each: INPUT may follow.
  set->AddRepeatable(
      "--pixel", "X,Y",
      [flags](absl::string_view text) {
        flags->pixels.emplace_back(text);
        return absl::OkStatus();
      },
      "a pixel of the picture: column and row from the top left; repeatable");
  set->AddSwitch("--all-fields", &flags->all_fields,
                 "also print the values of all fields at the points, of datasets that have fields");
  set->AddSwitch("--json", &flags->is_json, "print JSON");
  client::AddRequestFlags(set, &flags->request);
  set->Remove("--region");  // --pixel refers to the whole picture
  client::AddViewFlags(set, &flags->view);
  return [flags](const Context& context) { return Run(*flags, context); };
}

}  // namespace

Command PickCommand() {
  return {.name = "pick",
          .summary =
              "Tells what pixels of a picture show: point, surface, normal, gradient, block, shard",
          .usage = "INPUT | DIR | --server HOST:PORT --isovalue V --pixel X,Y [OPTIONS]",
          .examples =
              "  isoscope pick head.nii.gz --isovalue 60 --azimuth 30 --pixel 512,400\n"
              "  isoscope pick head.nii.gz --isovalue 60 --view anterior --fit surface \\\n"
              "    --pixel 9,8\n"
              "  isoscope pick --server localhost:50051 --isovalue 60 --pixel 1,2 \\\n"
              "    --pixel 3,4 --json\n"
              "  isoscope pick flow --field temperature --isovalue 310 --pixel 512,400 \\\n"
              "    --all-fields\n",
          .register_flags = RegisterPickFlags};
}

}  // namespace isoscope::cli
