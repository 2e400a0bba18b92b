// Agents that say anything: the coordinator takes their messages of a frame, their surfaces and
// their answers. agent_client, frame_coordinator, agent_queries and surface_stream are behind it.
//
// Input: a byte that chooses the client's call, a byte of ways (1: the agent waits for the
// coordinator's message after each step; 2: bands get right checksums; 4: so do bands whose decoded
// parts are changed), a byte for the code that ends the agent's call, with 4 a piece of changes,
// then a piece for each message of the agent.
//
// The client's call ends, and never says that the client was wrong, unless an agent does. With a
// well-behaved agent the picture then is that of before.

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include <grpcpp/client_context.h>

#include "core/base/coding.h"
#include "core/base/compression.h"
#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/base/task_arena.h"
#include "core/composite/band_format.h"
#include "core/composite/pixel_codec.h"
#include "core/math/exact_sum.h"
#include "isoscope/v1/dataset_service.grpc.pb.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "rpc/grpc_status.h"
#include "rpc/grpc_time.h"
#include "server/coordinator_server.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/unit/server/fake_agent.h"
#include "wire/proto_convert.h"

namespace isoscope::fuzz {
namespace {

namespace v1 = isoscope::v1;
namespace internal = isoscope::internal::v1;
using testing::FakeAgent;

constexpr absl::Duration kPatience = absl::Seconds(60);
constexpr int kInputsBetweenGoodFrames = 64;
constexpr int kWidthPx = 32;
constexpr int kHeightPx = 16;

// The agent's next actions.
struct Script {
  bool is_good = true;
  bool waits = false;
  bool seals = false;
  std::string changes = {};  // of the decoded parts of bands: 4 bytes each, place and mask
  grpc::StatusCode end = grpc::StatusCode::OK;
  std::vector<std::string> messages = {};
};

constexpr std::size_t kFrameSizeOffset = 48;  // docs/format/wire.md
constexpr std::size_t kMaxSideBytes = std::size_t{1} << 20;

// Changes a band between what its checksum, its sizes and its compression protect: header, side
// information (coverage, owners, palette), control bytes and extra bits. As it was if it is no
// band.
std::string Changed(const std::string& band, absl::string_view changes) {
  if (band.size() < composite::kBandHeaderSize) {
    return band;
  }
  const absl::string_view bytes(band);
  const auto frame_size = base::LoadLittleEndian<std::uint32_t>(band.data() + kFrameSizeOffset);
  const absl::string_view frame = bytes.substr(composite::kBandHeaderSize, frame_size);
  const absl::StatusOr<std::string> side = base::Decompress(frame, kMaxSideBytes);
  if (!side.ok()) {
    return band;
  }
  std::string parts = absl::StrCat(bytes.substr(0, composite::kBandHeaderSize), *side,
                                   bytes.substr(composite::kBandHeaderSize + frame.size()));
  for (; changes.size() >= 4; changes.remove_prefix(4)) {
    const auto change = base::LoadLittleEndian<std::uint32_t>(changes.data());
    char& target = parts[(change & 0xffffff) % parts.size()];
    target = static_cast<char>(static_cast<unsigned char>(target) ^ (change >> 24));
  }
  const absl::string_view changed(parts);
  const std::string packed =
      base::Compress(changed.substr(composite::kBandHeaderSize, side->size()));
  std::string result = absl::StrCat(changed.substr(0, composite::kBandHeaderSize), packed,
                                    changed.substr(composite::kBandHeaderSize + side->size()));
  base::StoreLittleEndian(static_cast<std::uint32_t>(packed.size()),
                          result.data() + kFrameSizeOffset);
  composite::SealBand(&result);
  return result;
}

class Cluster {
 public:
  Cluster() {
    agent_.on_frame = [this](grpc::ServerContext*, FakeAgent::FrameStream* stream) {
      const std::shared_ptr<const Script> now = script();
      return now->is_good ? testing::PlayEmptyFrame(stream) : PlayFrame(*now, stream);
    };
    agent_.on_frame_end = agent_.on_frame;
    agent_.on_surface = [this](grpc::ServerContext*, FakeAgent::SurfaceWriter* writer) {
      const std::shared_ptr<const Script> now = script();
      for (const std::string& bytes : now->messages) {
        internal::ExtractSurfaceResponse response;
        if (response.ParseFromString(bytes) && !writer->Write(response)) {
          break;
        }
      }
      return End(*now);
    };
    agent_.on_histogram = [this](grpc::ServerContext*, const auto&,
                                 internal::GetShardHistogramResponse* response) {
      return Answer(response);
    };
    agent_.on_active_box = [this](const auto&, internal::GetActiveBoxResponse* response) {
      return Answer(response);
    };
    agent_.on_cell_box = [this](const auto&, internal::GetCellBoxResponse* response) {
      return Answer(response);
    };
    agent_.on_resolved_blocks = [this](const auto&, internal::GetResolvedBlocksResponse* response) {
      return Answer(response);
    };
    agent_.on_depth_bounds = [this](const auto&, internal::GetDepthBoundsResponse* response) {
      return Answer(response);
    };
    agent_.Start();
    server::CoordinatorServerOptions options;
    options.agents = {{agent_.address(), nullptr}};
    options.poll_interval = absl::Hours(1);
    options.arena = std::make_shared<base::TaskArena>(1);
    auto coordinator = server::CoordinatorServer::Start(options);
    Require(
        coordinator.ok() && (*coordinator)->WaitUntilReady(base::MonotonicNow() + kPatience).ok(),
        "a coordinator can be started");
    coordinator_ = *std::move(coordinator);
    isosurface = v1::IsosurfaceService::NewStub(coordinator_->InProcessChannel());
    datasets = v1::DatasetService::NewStub(coordinator_->InProcessChannel());
  }
  ~Cluster() { coordinator_.reset(); }  // it calls the agent: it goes first
  Cluster(const Cluster&) = delete;
  Cluster& operator=(const Cluster&) = delete;

  // The client's call may end before the agent's: that one keeps the script it began with.
  [[nodiscard]] std::shared_ptr<const Script> script() const {
    const base::MutexLock lock(&mutex_);
    return script_;
  }
  void Play(Script script) {
    auto next = std::make_shared<const Script>(std::move(script));
    const base::MutexLock lock(&mutex_);
    script_ = std::move(next);
  }

  std::unique_ptr<v1::IsosurfaceService::Stub> isosurface;
  std::unique_ptr<v1::DatasetService::Stub> datasets;

 private:
  static grpc::Status End(const Script& script) {
    return script.end == grpc::StatusCode::OK ? grpc::Status::OK
                                              : grpc::Status(script.end, "the script says so");
  }

  template <typename Response>
  grpc::Status Answer(Response* response) const {
    const std::shared_ptr<const Script> now = script();
    if (now->is_good || now->messages.empty()) {
      return {grpc::StatusCode::UNAVAILABLE, "no answer"};
    }
    Response parsed;
    if (parsed.ParseFromString(now->messages.front())) {
      *response = parsed;
    }
    return End(*now);
  }

  static grpc::Status PlayFrame(const Script& script, FakeAgent::FrameStream* stream) {
    internal::RenderFrameRequest request;
    stream->Read(&request);
    for (const std::string& bytes : script.messages) {
      internal::RenderFrameResponse response;
      if (!response.ParseFromString(bytes)) {
        continue;
      }
      for (std::string& band : *response.mutable_bands()) {
        if (!script.changes.empty()) {
          band = Changed(band, script.changes);
        } else if (script.seals && band.size() >= composite::kBandHeaderSize) {
          composite::SealBand(&band);
        }
      }
      if (!stream->Write(response)) {
        break;
      }
      if (script.waits && (response.has_ray_hits() || response.has_occluders_done()) &&
          !stream->Read(&request)) {
        break;
      }
    }
    return End(script);
  }

  mutable base::Mutex mutex_;
  std::shared_ptr<const Script> script_ ABSL_GUARDED_BY(mutex_) = std::make_shared<const Script>();
  FakeAgent agent_{{testing::MakeShard("head", 0, 1)}};
  std::unique_ptr<server::CoordinatorServer> coordinator_;
};

Cluster& TheCluster() {
  static Cluster cluster;
  return cluster;
}

struct Call {
  Call() { context.set_deadline(base::MonotonicNow() + kPatience); }
  grpc::ClientContext context;
};

void RequireEnd(const grpc::Status& grpc_status) {
  const absl::Status status = rpc::ToAbslStatus(grpc_status);
  // If an agent rejects a question in the client's own words, the client is at fault.
  const bool is_blamed_by_agent =
      absl::IsInvalidArgument(status) && TheCluster().script()->end == grpc::INVALID_ARGUMENT;
  if (!status.ok() && !is_blamed_by_agent) {
    using absl::StatusCode;
    RequireError(status, {StatusCode::kInternal, StatusCode::kUnavailable, StatusCode::kDataLoss,
                          StatusCode::kFailedPrecondition, StatusCode::kResourceExhausted});
  }
}

// `choice` mod 4 is the kind of frame; 16: light from a side, so that agents send normals; 32:
// three surfaces; 64: cuts that show samples.
v1::RenderIsosurfaceRequest Request(std::uint8_t choice) {
  v1::RenderIsosurfaceRequest request;
  request.set_dataset("head");
  request.set_isovalue(100);
  request.mutable_viewport()->set_width_px(kWidthPx);
  request.mutable_viewport()->set_height_px(kHeightPx);
  if (choice % 4 == 1) {
    request.set_culling(v1::CULLING_NONE);
  } else if (choice % 4 == 2) {
    request.mutable_output()->set_normal(true);
    request.mutable_output()->set_position(true);
    request.set_with_trace(true);
  } else if (choice % 4 == 3) {
    request.clear_isovalue();
    request.add_surfaces()->set_isovalue(100);
    request.mutable_surfaces(0)->mutable_color()->set_alpha(0.5F);
    request.set_max_layers(3);
  }
  if ((choice & 16) != 0) {
    request.add_lights()->mutable_direction()->set_x(1);
  }
  if ((choice & 32) != 0) {
    request.clear_isovalue();
    while (request.surfaces_size() < 3) {
      request.add_surfaces()->set_isovalue(90 + 10 * request.surfaces_size());
    }
  }
  if ((choice & 64) != 0) {
    request.mutable_clip()->add_half_spaces()->mutable_normal()->set_x(1);
    request.mutable_caps()->set_color_map(v1::COLOR_MAP_VIRIDIS);
  }
  return request;
}

grpc::Status Render(const v1::RenderIsosurfaceRequest& request, std::string* png) {
  Call call;
  v1::RenderIsosurfaceResponse response;
  const grpc::Status status =
      TheCluster().isosurface->RenderIsosurface(&call.context, request, &response);
  *png = response.png();
  return status;
}

void Run(Input input) {
  Cluster& cluster = TheCluster();
  const std::uint8_t choice = input.Byte();
  const std::uint8_t ways = input.Byte();
  constexpr grpc::StatusCode kEnds[] = {grpc::StatusCode::OK,
                                        grpc::StatusCode::OK,
                                        grpc::StatusCode::INVALID_ARGUMENT,
                                        grpc::StatusCode::RESOURCE_EXHAUSTED,
                                        grpc::StatusCode::CANCELLED,
                                        grpc::StatusCode::INTERNAL};
  Script script = {.is_good = false,
                   .waits = (ways & 1) != 0,
                   .seals = (ways & 2) != 0,
                   .end = kEnds[input.Byte() % std::size(kEnds)]};
  if ((ways & 4) != 0) {
    script.changes = std::string(input.Piece());
  }
  while (!input.empty() && script.messages.size() < 16) {
    script.messages.emplace_back(input.Piece());
  }
  cluster.Play(std::move(script));
  std::string png;
  Call call;
  if (choice % 8 < 5) {
    v1::RenderIsosurfaceRequest request = Request(choice & 0xf3);
    if (choice % 8 == 4) {
      // Asks for the box of the active blocks, or of the active cells.
      request.set_camera_fit((choice & 0x10) != 0 ? v1::CAMERA_FIT_CELLS : v1::CAMERA_FIT_SURFACE);
    }
    RequireEnd(Render(request, &png));
  } else if (choice % 8 == 5) {
    v1::PickSurfaceRequest pick;
    *pick.mutable_frame() = Request(0);
    pick.add_pixels()->set_x(3);
    v1::PickSurfaceResponse response;
    RequireEnd(cluster.isosurface->PickSurface(&call.context, pick, &response));
  } else if (choice % 8 == 6) {
    v1::ExportIsosurfaceRequest request;
    request.set_isovalue(100);
    const auto reader = cluster.isosurface->ExportIsosurface(&call.context, request);
    v1::ExportIsosurfaceResponse response;
    while (reader->Read(&response)) {
    }
    RequireEnd(reader->Finish());
  } else {
    v1::GetHistogramResponse response;
    RequireEnd(cluster.datasets->GetHistogram(&call.context, {}, &response));
  }
}

void RequireGoodFrame() {
  static std::string good_png;
  TheCluster().Play({});
  std::string png;
  Require(Render(Request(0), &png).ok(), "a good agent's picture is made");
  if (good_png.empty()) {
    good_png = png;
  }
  Require(png == good_png, "a picture is the same whatever agents said before");
}

}  // namespace

std::vector<std::string> Seeds() {
  const auto head = [](int choice, int ways) {
    return std::string{static_cast<char>(choice), static_cast<char>(ways), '\0'};
  };
  const auto piece = [](const google::protobuf::Message& message) {
    return MakePiece(message.SerializeAsString());
  };
  image::FrameImage image(kWidthPx, kHeightPx);
  for (int i = 0; i < 200; ++i) {
    image.Set(i % kWidthPx, i / kWidthPx,
              image::FragmentKey(0.3F, static_cast<std::uint32_t>(i % 8)), {9, 8, 7, 255});
  }
  internal::RenderFrameResponse hits;
  *hits.mutable_ray_hits()->mutable_hits() = wire::ToProto(std::vector<volume::BlockId>{0, 3});
  *hits.mutable_ray_hits()->mutable_active_blocks() =
      wire::ToProto(std::vector<volume::BlockId>{0, 1, 3, 5});
  internal::RenderFrameResponse occluders;
  occluders.mutable_occluders_done();
  for (const std::string& band : composite::EncodePixels(image)) {
    occluders.add_bands(band);
  }
  internal::RenderFrameResponse done;
  done.mutable_frame_done()->mutable_statistics()->set_triangle_count(7);
  internal::RenderFrameResponse all = done;
  *all.mutable_bands() = occluders.bands();
  internal::ExtractSurfaceResponse surface;
  internal::BlockSurface* const block = surface.add_blocks();
  block->set_block_id(1);
  block->set_positions(std::string(36, '\0'));
  block->set_normals(std::string(36, '\0'));
  block->set_copies(std::string("\0\1\2", 3));
  block->set_triangles(std::string("\0\0\0\0\1\0\0\0\2\0\0\0", 12));
  const std::string sum = math::ExactSum().Encode();
  surface.mutable_sums()->set_area(sum);
  surface.mutable_sums()->set_volume(sum);
  surface.mutable_sums()->set_triangle_count(1);
  surface.mutable_sums()->set_open_edge_count(3);
  internal::GetShardHistogramResponse histogram;
  histogram.set_first_bin(10);
  histogram.set_stored_bin_count(1);
  histogram.set_bins_per_group_count(1);
  histogram.add_active_block_counts(3);
  histogram.add_active_block_bytes(300);
  histogram.add_estimated_triangle_counts(51);
  histogram.mutable_label_values()->add_values(3);
  histogram.mutable_label_values()->set_other_value(0.5);
  internal::GetActiveBoxResponse box;
  box.set_active_block_count(1);
  box.mutable_begin_cell();
  box.mutable_end_cell()->set_x(4);
  box.mutable_end_cell()->set_y(4);
  box.mutable_end_cell()->set_z(4);
  const std::string frame = piece(hits) + piece(occluders) + piece(done);
  // Owners of no surface, opaque and translucent, in bands that are right in all else.
  constexpr std::uint32_t kNobody = std::uint32_t{1} << 31;
  image.Set(7, 7, image::FragmentKey(0.2F, kNobody), {9, 8, 7, 255});
  const auto images = image::FrameImagePool::Make(std::size_t{1} << 20);
  image::LayerStack layers(kWidthPx, kHeightPx, 3, {.block_count = 8}, images.get());
  layers.Insert(9, 9, image::FragmentKey(0.2F, kNobody), {9, 8, 7, 255});
  internal::RenderFrameResponse hostile;
  hostile.mutable_occluders_done();
  for (const std::string& band : composite::EncodePixels(image)) {
    hostile.add_bands(band);
  }
  for (const std::string& band : composite::EncodeLayers(layers)) {
    hostile.add_bands(band);
  }
  const std::string hostile_frame = piece(hits) + piece(hostile) + piece(done);
  // The owners follow the header, the bits and masks of tiles, and their dictionary sizes.
  const std::string changes = MakePiece(std::string("\x9a\0\0\x80\x9b\0\0\x10", 8));
  return {head(3, 1) + hostile_frame,
          head(48, 1) + hostile_frame,
          head(112, 1) + hostile_frame,
          head(51, 5) + changes + hostile_frame,
          head(48, 5) + changes + frame,
          head(115, 5) + changes + frame,
          head(0, 3) + frame,
          head(2, 1) + frame,
          head(3, 1) + frame,
          head(0, 0) + frame,
          head(1, 2) + piece(all),
          head(5, 1) + frame,
          head(4, 1) + piece(box),
          head(6, 0) + piece(surface),
          head(7, 0) + piece(histogram)};
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static int count = 0;
  isoscope::fuzz::Run(isoscope::fuzz::Input(data, size));
  if (count++ % isoscope::fuzz::kInputsBetweenGoodFrames == 0) {
    isoscope::fuzz::RequireGoodFrame();
  }
  return 0;
}
