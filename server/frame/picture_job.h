// The drawing of one call: picture and planes of a frame, from the request to the response.
//
// 1. Admit converts the request. An error that no state of the cluster could change is answered at
//    once. Then the ticket takes a place.
// 2. Run waits for memory and finds the target (FrameRunner::Prepare). Colour maps get their ranges
//    (color_ranges). RunFrame does the work with the agents (frame_coordinator). If the cache knows which blocks are active, agents need not
//    report them; otherwise their report goes into the cache.
// 3. Picture and planes are encoded, in the arena of the runner.
// 4. With notes, surfaces that do not show are looked for (surface_notes). Bounds of depth come from
//    the ranges of blocks, not from the drawing: the agents are asked for them last.
//
// What does not fit memory, of the coordinator or of an agent, is drawn in bands: regions of the
// picture, each with steps 2 and 3, that a BandJoiner joins. Camera and colour ranges are resolved
// before, for the whole. If an agent has no memory for a band, all begins again with bands of half
// the pixels. DrawnBlocks keeps what was counted.
//
// A picture with several samples, or with effects that read neighbouring pixels, is drawn in a
// larger window (core/frame/drawn_window) and finished by picture_finish. Planes are those of one
// sample, so a frame with samples and planes is drawn twice. Normals replace colours in the
// messages of agents: a frame with a picture and normals is drawn twice, too. The picture of a
// frame with lights or a color_by is computed from normals (core/picture/deferred_shading).
//
// A view at rest may have a large picture tile by tile (picture_tiles.cc): bands in another order,
// each under a ticket of its own, so that other callers have their turn between them.
//
// A trace (with_trace) has the times of all these steps. The coordinator's own times come from a
// recorder that the job passes down, the agents' from their streams. The call's begin is time zero.
// Of many bands only the first ones have details.

#ifndef ISOSCOPE_SERVER_FRAME_PICTURE_JOB_H_
#define ISOSCOPE_SERVER_FRAME_PICTURE_JOB_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/memory_budget.h"
#include "core/base/trace_recorder.h"
#include "core/frame/drawn_window.h"
#include "core/image/frame_image.h"
#include "core/image/layer_stack.h"
#include "core/math/vec.h"
#include "core/picture/picture_contents.h"
#include "isoscope/v1/interact_service.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "server/admission/band_grid.h"
#include "server/frame/drawn_blocks.h"
#include "server/frame/frame_ends.h"
#include "server/frame/frame_runner.h"
#include "server/frame/frame_ticket.h"
#include "server/picture/band_joiner.h"
#include "server/picture/depth_grid.h"
#include "server/picture/frame_output.h"

namespace isoscope::server {

// What is known of a frame before it is drawn.
struct FrameFacts {
  int level = 0;                  // that is drawn
  int asked_level = 0;            // that it asks for; `level` may be coarser
  int coarsest_level = 0;         // of those that it could be drawn from
  double spacing_px = 0;          // of the level
  math::Vec3d spacing = {};       // of the level, in world units
  std::int64_t active_bytes = 0;  // of the samples of the level's active blocks
  bool may_tile = false;
};

// Holds the images. Its destructor clears them for their pool, so destroy it once the client has
// its answer. For one thread at a time.
class PictureJob {
 public:
  using Request = isoscope::v1::RenderIsosurfaceRequest;
  using Response = isoscope::v1::RenderIsosurfaceResponse;

  static absl::StatusOr<std::unique_ptr<PictureJob>> Admit(FrameRunner* runner,
                                                           std::shared_ptr<FrameTicket> ticket,
                                                           const Request& request);
  // depth_grid_side: points on the longer side of the picture's depth grid; 0: none is made. A
  // region that is drawn with a margin has none.
  // coarser: not set: the frame is of the level that it asks for; set: its answer tells the level
  static absl::StatusOr<std::unique_ptr<PictureJob>> Admit(
      FrameRunner* runner, std::shared_ptr<FrameTicket> ticket, AskedFrame asked,
      int depth_grid_side, std::optional<CoarserLevel> coarser = std::nullopt);

  // Renders the frame into `response`. Blocks. Calls `on_drawn` once the agents have drawn a
  // picture, before it is encoded. Errors as IsosurfaceService says. Call once.
  absl::Status Run(
      Response* response, absl::FunctionRef<void()> on_drawn = [] {});

  // The same, if `begins` says so once the frame's facts are known. If not, draws nothing, and returns
  // OK without a response. Then the frame may be drawn in tiles.
  absl::Status RunIf(absl::FunctionRef<bool(const FrameFacts& facts)> begins, Response* response,
                     absl::FunctionRef<void()> on_drawn);

  // Tiles are bands that each have a ticket of their own, and are answered on their own
  // (picture_tiles.cc). Begins them, with a grid whose tiles have about this side. Returns false if
  // there is no memory now for the picture's pixels between them, or if the picture is one tile.
  // REQUIRES: RunIf drew nothing, and its facts allow tiles.
  bool BeginTiles(int side_px);
  // Null before BeginTiles has returned true.
  [[nodiscard]] const BandGrid* tile_grid() const;
  // Returns the frame of a tile, for its ticket.
  [[nodiscard]] frame::FrameSpec SpecOfTile(int tile) const;
  // Draws a tile, into `proto`, under a ticket that has a place for SpecOfTile. Blocks. Errors as
  // Run. After one, no other tile may be drawn. REQUIRES: BeginTiles has returned true, and the tile
  // was not drawn.
  absl::Status RunTile(std::shared_ptr<FrameTicket> ticket, int tile, isoscope::v1::Tile* proto);
  // Makes the response of the frame, as Run, from its tiles. REQUIRES: all were drawn; the ticket has
  // a place for the frame.
  absl::Status FinishTiles(std::shared_ptr<FrameTicket> ticket, Response* response);

  // The frame that is drawn.
  [[nodiscard]] const frame::FrameSpec& spec() const { return asked_.spec; }
  [[nodiscard]] const std::optional<DepthGrid>& depth_grid() const { return depth_grid_; }
  // What was drawn; zeros before.
  [[nodiscard]] const FrameFacts& facts() const { return facts_; }

 private:
  struct Trace {
    explicit Trace(std::size_t max_spans) : recorder(max_spans) {}
    base::TraceRecorder recorder;
    const base::TraceTime zero = base::TraceClock::now();
    std::vector<isoscope::v1::ProcessTrace> of_agents = {};
  };

  // Pixels for the picture, or for the planes. Pictures have colours, or normals to shade; planes
  // have normals if they are asked for.
  enum class Content { kPicture, kPlanes };

  PictureJob(FrameRunner* runner, std::shared_ptr<FrameTicket> ticket, AskedFrame asked,
             int depth_grid_side, std::optional<CoarserLevel> coarser);

  // What is drawn at a time: the picture, or a band of it.
  struct Piece {
    const frame::FrameSpec& spec;
    const FrameTarget& target;  // its view is the spec's
    view::Region band = {};     // in pixels of the picture
    DrawingContext context = {};
    DrawnBlocks* drawn = nullptr;  // gets the blocks of a band; null: drawn at once
    BandJoiner* joiner = nullptr;  // gets the picture of a band; null: it is encoded
  };

  // Does `work` under the ticket, then tells agents that no call follows.
  absl::Status RunWork(const frame::FrameSpec& spec, absl::FunctionRef<absl::Status()> work);
  using Begins = absl::FunctionRef<bool(const FrameFacts& facts)>;
  // begins: null: begins at once
  absl::Status TryRun(const Begins* begins, Response* response, absl::FunctionRef<void()> on_drawn);
  absl::StatusOr<FrameFacts> FindFacts(const FrameTarget& target);
  // Makes the response, of a picture that is drawn.
  absl::Status Complete(const FrameTarget& target, FrameOutput output, Response* response);
  // Sets the facts of what was drawn.
  void NoteDrawn(const FrameTarget& target);
  // Finds the ranges of maps, and draws the picture.
  absl::Status RenderInRanges(const FrameTarget& target, absl::FunctionRef<void()> on_drawn,
                              FrameOutput* output);
  absl::Status RenderOutput(const FrameTarget& target, absl::FunctionRef<void()> on_drawn,
                            FrameOutput* output);
  // What bands are planned for: the picture, or the drawings of its values (SpecOfValues).
  struct Drawing {
    const frame::FrameSpec& spec;
    bool is_of_values = false;
  };
  [[nodiscard]] absl::StatusOr<BandGrid> Plan(const Drawing& drawing,
                                              const FrameNeeds& needs) const;
  absl::StatusOr<BandGrid> FirstPlan(const Drawing& drawing, const FrameTarget& target,
                                     FrameNeeds* needs);
  // Returns `error` if no smaller bands could help.
  absl::StatusOr<BandGrid> SmallerPlan(const Drawing& drawing, const FrameTarget& target,
                                       const BandGrid& bands, const absl::Status& error,
                                       FrameNeeds* needs);
  // Keeps the size of bands that agents had room for, after a refusal of larger ones.
  void NoteRoom(const FrameTarget& target, const FrameNeeds& needs);
  absl::Status RenderAtOnce(const FrameTarget& target, absl::FunctionRef<void()> on_drawn,
                            FrameOutput* output);
  absl::Status RenderBands(const FrameTarget& target, const BandGrid& bands,
                           absl::FunctionRef<void()> on_drawn, FrameOutput* output);
  absl::Status RenderAllBands(const FrameTarget& target, const BandGrid& bands,
                              absl::FunctionRef<void()> on_drawn, BandJoiner* joiner);
  // Returns how many bands the trace has details of; 0: none is asked for.
  [[nodiscard]] int DetailedBandCount(int band_count) const;
  // Draws a band of the picture, given in its pixels, and adds its cost to `cost`.
  struct BandsOfPicture {
    const FrameTarget& target;
    DrawnBlocks* drawn;
    BandJoiner* joiner;
    int drawing_count = 1;
  };
  absl::Status RenderBandOf(const BandsOfPicture& picture, const view::Region& band, bool is_last,
                            absl::FunctionRef<void()> on_drawn, std::optional<FrameCost>* cost);
  absl::Status RenderBand(const Piece& piece, absl::FunctionRef<void()> on_drawn);
  // What is kept between the tiles of a picture.
  struct Tiles {
    FrameTarget target;
    BandGrid grid;
    base::MemoryBudget::Reservation memory;
    DrawnBlocks drawn;
    std::optional<BandJoiner> joiner = std::nullopt;  // from the first tile on
    std::optional<FrameCost> cost = std::nullopt;     // of the tiles so far
  };
  absl::Status PrepareTiles();
  absl::Status RenderTile(const frame::FrameSpec& spec, const view::Region& tile);
  // Both set cost_ to the cost of the piece.
  absl::Status RenderPicture(const Piece& piece, absl::FunctionRef<void()> on_drawn,
                             FrameOutput* output);
  absl::Status RenderPlanes(const Piece& piece, FrameOutput* output);
  absl::Status FinishAndEncode(const Piece& piece, const frame::DrawnWindow& window,
                               const view::View& drawn_view, FrameOutput* output);
  void AddToDepthGrid(const Piece& piece, const frame::DrawnWindow& window,
                      const view::View& drawn_view);
  void StartAgain(FrameOutput* output);
  // Gives all maps their ranges.
  absl::Status FindRanges(const FrameTarget& target);
  // Finds the notes on surfaces. A picture without them is still right.
  absl::Status FindNotes(const FrameTarget& target);
  // Counts what a level shows nothing of. A picture without the number is still right.
  absl::Status FindUnresolved(const FrameTarget& target);
  // Adds the plane of bounds, rows by rows.
  absl::Status FindBounds(const FrameTarget& target, FrameOutput* output);
  // Converts all but the trace.
  void FillResponse(const FrameTarget& target, FrameOutput output, Response* response) const;
  absl::StatusOr<FrameResult> Draw(const Piece& piece, const FrameTarget& target,
                                   const frame::DrawnWindow& window, Content content);
  [[nodiscard]] FrameIdentity Identity();
  void AddTrace(base::TraceTime begin, Response* response);
  void ReleaseImages();
  [[nodiscard]] base::TraceRecorder* recorder() const {
    return trace_ == nullptr || !has_details_ ? nullptr : &trace_->recorder;
  }

  FrameRunner& runner_;
  std::shared_ptr<FrameTicket> ticket_;  // of the tile that is drawn, if it is one
  AskedFrame asked_;                     // FindTarget resolves its camera, FindRanges its ranges
  const int depth_grid_side_;
  const std::optional<CoarserLevel> coarser_;
  std::optional<DepthGridBuilder> depth_grid_builder_;  // not set: no grid is made
  std::optional<DepthGrid> depth_grid_;
  std::unique_ptr<Trace> trace_;  // null: none is asked for
  std::vector<FramePart> parts_;  // of the target, without those that were lost meanwhile
  FollowingCalls following_;      // of the ticket's frame
  FrameCost cost_;
  std::vector<isoscope::v1::SurfaceNote> notes_;
  image::FrameImage image_;
  image::FrameImage drawn_;   // if it differs from image_
  image::LayerStack layers_;  // layers of the drawn image
  picture::PictureContents contents_;
  view::Viewport band_;      // of the picture, at most; all of it if it is drawn at once
  bool has_details_ = true;  // of what is drawn, in the trace
  FrameFacts facts_;
  std::optional<FrameTarget> put_off_;  // the target of a frame that RunIf did not draw
  std::unique_ptr<Tiles> tiles_;        // null: there are none
};

// Returns the level that is drawn.
isoscope::v1::DrawnLevel ToProto(const FrameFacts& facts);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_PICTURE_JOB_H_
