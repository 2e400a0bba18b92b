// FindGap subtracts the pieces from the box of the whole, one after the other. Subtract cuts the
// box at the faces of the piece, axis by axis. In two dimensions, first x, then y:
//
//   +---+---+---+
//   |   | 3 |   |   1 and 2 lie beside the piece in x; 3 and 4 lie beside it in y. The inside of
//   | 1 |###| 2 |   the piece is dropped. In three dimensions at most six boxes remain.
//   |   | 4 |   |
//   +---+---+---+
//
// ReadRows goes from plane to plane. It writes the pieces from the last to the first, so the first
// one counts where they overlap. ReadPiece reads whole rows of a piece, as many as 256 KiB hold,
// and copies its box. The list of open pieces is ordered by use, the last used first.

#include "core/source/adapt/pieces_source.h"

#include <algorithm>
#include <list>
#include <utility>

#include "absl/strings/str_cat.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kOpenPieces = 16;
constexpr std::int64_t kPieceRowBytes = 256 * base::kKiB;
constexpr std::size_t kMaxLeftBoxes = 65'536;

struct IndexBox {
  math::Index3 begin;
  math::Index3 end;
};

// Appends `box` without `piece` to `left`, as boxes that do not overlap.
void Subtract(IndexBox box, const SamplePiece& piece, std::vector<IndexBox>* left) {
  for (int axis = 0; axis < 3; ++axis) {
    if (piece.begin[axis] >= box.end[axis] || piece.end[axis] <= box.begin[axis]) {
      left->push_back(box);
      return;
    }
    if (piece.begin[axis] > box.begin[axis]) {
      left->push_back(box);
      left->back().end[axis] = piece.begin[axis];
      box.begin[axis] = piece.begin[axis];
    }
    if (piece.end[axis] < box.end[axis]) {
      left->push_back(box);
      left->back().begin[axis] = piece.end[axis];
      box.end[axis] = piece.end[axis];
    }
  }
}

class PiecesSource final : public VolumeSource {
 public:
  PiecesSource(SourceInfo info, std::vector<SamplePiece> pieces, std::int64_t piece_bytes,
               OpenPiece open)
      : VolumeSource(WithMemory(std::move(info), pieces.size(), piece_bytes)),
        pieces_(std::move(pieces)),
        open_(std::move(open)) {}

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    const math::Index3& dims = info().geometry.sample_dims;
    ISOSCOPE_CHECK(begin_row >= 0 && begin_row < end_row && end_row <= dims.y * dims.z);
    while (begin_row < end_row) {
      const std::int64_t z = begin_row / dims.y;
      const std::int64_t y = begin_row % dims.y;
      const std::int64_t end_y = std::min(dims.y, y + end_row - begin_row);
      // The first piece is the last that is written.
      for (std::size_t piece = pieces_.size(); piece-- > 0;) {
        ISOSCOPE_RETURN_IF_ERROR(ReadPiece(piece, z, y, end_y, out));
      }
      out += (end_y - y) * info().row_bytes();
      begin_row += end_y - y;
    }
    return absl::OkStatus();
  }

  void HeedCancellation(const base::Cancellation* cancellation) override {
    cancellation_ = cancellation;
    for (Opened& opened : opened_) {
      opened.source->HeedCancellation(cancellation);
    }
  }

 private:
  struct Opened {
    std::size_t piece;
    std::unique_ptr<VolumeSource> source;
  };

  static SourceInfo WithMemory(SourceInfo info, std::size_t pieces, std::int64_t piece_bytes) {
    info.memory_bytes = static_cast<std::int64_t>(std::min(kOpenPieces, pieces)) * piece_bytes +
                        std::max(kPieceRowBytes, info.row_bytes()) +
                        static_cast<std::int64_t>(pieces * sizeof(SamplePiece));
    return info;
  }
  [[nodiscard]] std::int64_t sample_bytes() const {
    return static_cast<std::int64_t>(volume::SizeOf(info().type));
  }

  // Reads a piece's part of rows [begin_y, end_y) of plane z, which `out` holds.
  absl::Status ReadPiece(std::size_t index, std::int64_t z, std::int64_t begin_y,
                         std::int64_t end_y, char* out) {
    const SamplePiece& piece = pieces_[index];
    std::int64_t y = std::max(begin_y, piece.begin.y);
    const std::int64_t stop = std::min(end_y, piece.end.y);
    if (z < piece.begin.z || z >= piece.end.z || y >= stop || piece.begin.x >= piece.end.x) {
      return absl::OkStatus();
    }
    ISOSCOPE_ASSIGN_OR_RETURN(VolumeSource * source, Source(index));
    const math::Index3& dims = source->info().geometry.sample_dims;
    const std::int64_t row_bytes = dims.x * sample_bytes();
    const std::int64_t rows_at_once = std::max<std::int64_t>(kPieceRowBytes / row_bytes, 1);
    const auto size = static_cast<std::size_t>((piece.end.x - piece.begin.x) * sample_bytes());
    while (y < stop) {
      const std::int64_t rows = std::min(rows_at_once, stop - y);
      rows_.resize(static_cast<std::size_t>(rows * row_bytes));
      const std::int64_t first_row = (z - piece.first.z) * dims.y + y - piece.first.y;
      ISOSCOPE_RETURN_IF_ERROR(source->ReadRows(first_row, first_row + rows, rows_.data()));
      const char* from = rows_.data() + (piece.begin.x - piece.first.x) * sample_bytes();
      for (std::int64_t i = 0; i < rows; ++i, ++y, from += row_bytes) {
        std::copy_n(from, size,
                    out + (y - begin_y) * info().row_bytes() + piece.begin.x * sample_bytes());
      }
    }
    return absl::OkStatus();
  }

  absl::StatusOr<VolumeSource*> Source(std::size_t piece) {
    const auto found = std::find_if(opened_.begin(), opened_.end(),
                                    [&](const Opened& opened) { return opened.piece == piece; });
    if (found != opened_.end()) {
      opened_.splice(opened_.begin(), opened_, found);
      return opened_.front().source.get();
    }
    if (opened_.size() == kOpenPieces) {
      opened_.pop_back();
    }
    ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSource> source, open_(piece));
    source->HeedCancellation(cancellation_);
    opened_.push_front({.piece = piece, .source = std::move(source)});
    return opened_.front().source.get();
  }

  const std::vector<SamplePiece> pieces_;
  const OpenPiece open_;
  std::list<Opened> opened_;  // the last used first
  const base::Cancellation* cancellation_ = nullptr;
  std::vector<char> rows_;  // of one piece
};

}  // namespace

absl::StatusOr<std::optional<math::Index3>> FindGap(const math::Index3& dims,
                                                    const std::vector<SamplePiece>& pieces) {
  std::vector<IndexBox> left{{.begin = {}, .end = dims}};
  std::vector<IndexBox> rest;
  for (const SamplePiece& piece : pieces) {
    rest.clear();
    for (const IndexBox& box : left) {
      Subtract(box, piece, &rest);
    }
    if (rest.size() > kMaxLeftBoxes) {
      return absl::ResourceExhaustedError(absl::StrCat(pieces.size(),
                                                       " pieces lie in no order: more than ",
                                                       kMaxLeftBoxes, " boxes between them"));
    }
    left.swap(rest);
  }
  return left.empty() ? std::nullopt : std::optional<math::Index3>(left.front().begin);
}

std::unique_ptr<VolumeSource> MakePiecesSource(SourceInfo info, std::vector<SamplePiece> pieces,
                                               std::int64_t piece_bytes, OpenPiece open) {
  return std::make_unique<PiecesSource>(std::move(info), std::move(pieces), piece_bytes,
                                        std::move(open));
}

}  // namespace isoscope::source
