// An image of the pool is background in all pixels, so that taking one clears nothing.
//
//   1. Take finds the unused image of this size that came back last, or makes one.
//   2. The image keeps a pointer to its pool. Its destructor calls TakeBack.
//   3. TakeBack clears the covered pixels, and drops the images that are unused for longest until
//      this one fits.
//
// Copies have no pool: they free their memory.

#include "core/image/frame_image.h"

#include <algorithm>
#include <new>
#include <utility>

#include "core/base/check.h"

namespace isoscope::image {
namespace {

std::size_t SizeBytes(const FrameImage& image) {
  return image.keys.capacity() * sizeof(std::uint64_t) + image.colors.capacity() * sizeof(Rgba8) +
         image.covered.capacity() * sizeof(TileMask);
}

// Makes the covered pixels background again.
void Clear(FrameImage* image) {
  for (int row = 0; row < image->touched.rows(); ++row) {
    image->touched.ForEachInRow(row, [&](int column) {
      const int begin_x = column * TileSet::kTilePx;
      const int count = std::min(TileSet::kTilePx, image->width - begin_x);
      TileMask& covered = image->CoveredOf(column, row);
      const int rows = std::min(TileSet::kTilePx, image->height - row * TileSet::kTilePx);
      for (int y = 0; y < rows; ++y) {
        // Clears the whole row of the tile, because stores without branches are faster.
        if (covered[static_cast<std::size_t>(y)] != 0) {
          const auto begin =
              static_cast<std::ptrdiff_t>(image->IndexOf(begin_x, row * TileSet::kTilePx + y));
          std::fill_n(image->keys.begin() + begin, count, kBackgroundKey);
          std::fill_n(image->colors.begin() + begin, count, Rgba8{});
        }
      }
      covered = {};
    });
  }
  image->touched.Clear();
}

}  // namespace

FrameImage::FrameImage(int image_width, int image_height)
    : width(image_width), height(image_height) {
  ISOSCOPE_CHECK_GE(width, 0);
  ISOSCOPE_CHECK_GE(height, 0);
  keys.assign(pixel_count(), kBackgroundKey);
  colors.assign(pixel_count(), Rgba8{});
  touched = TileSet(width, height);
  covered.resize(static_cast<std::size_t>(touched.columns()) *
                 static_cast<std::size_t>(touched.rows()));
}

FrameImage::~FrameImage() {
  if (pool_ != nullptr) {
    const std::shared_ptr<FrameImagePool> pool = std::move(pool_);
    pool->TakeBack(std::move(*this));
  }
}

FrameImage::FrameImage(FrameImage&& other) noexcept
    : width(std::exchange(other.width, 0)),
      height(std::exchange(other.height, 0)),
      keys(std::move(other.keys)),
      colors(std::move(other.colors)),
      touched(std::exchange(other.touched, TileSet())),
      covered(std::move(other.covered)),
      pool_(std::move(other.pool_)) {}

FrameImage& FrameImage::operator=(FrameImage&& other) noexcept {
  std::swap(width, other.width);
  std::swap(height, other.height);
  keys.swap(other.keys);
  colors.swap(other.colors);
  std::swap(touched, other.touched);
  covered.swap(other.covered);
  pool_.swap(other.pool_);
  return *this;
}

FrameImage::FrameImage(const FrameImage& other)
    : width(other.width),
      height(other.height),
      keys(other.keys),
      colors(other.colors),
      touched(other.touched),
      covered(other.covered) {}

FrameImage& FrameImage::operator=(const FrameImage& other) {
  if (this != &other) {
    *this = FrameImage(other);
  }
  return *this;
}

void FrameImage::Set(int x, int y, std::uint64_t key, Rgba8 color) {
  const int column = x / TileSet::kTilePx;
  const int row = y / TileSet::kTilePx;
  touched.Insert(column, row);
  CoveredOf(column, row)[static_cast<std::size_t>(y % TileSet::kTilePx)] |=
      static_cast<std::uint16_t>(1U << (x % TileSet::kTilePx));
  keys[IndexOf(x, y)] = key;
  colors[IndexOf(x, y)] = color;
}

void FrameImage::CoverAll() {
  constexpr int kTilePx = TileSet::kTilePx;
  touched.InsertAll();
  for (int row = 0; row < touched.rows(); ++row) {
    for (int column = 0; column < touched.columns(); ++column) {
      const int columns = std::min(kTilePx, width - column * kTilePx);
      const int rows = std::min(kTilePx, height - row * kTilePx);
      TileMask& mask = CoveredOf(column, row);
      std::fill_n(mask.begin(), rows, static_cast<std::uint16_t>((1U << columns) - 1));
    }
  }
}

std::shared_ptr<FrameImagePool> FrameImagePool::Make(std::size_t max_bytes) {
  return std::shared_ptr<FrameImagePool>(new FrameImagePool(max_bytes));
}

FrameImage FrameImagePool::Take(int width, int height) {
  FrameImage image;
  {
    base::MutexLock lock(&mutex_);
    const auto fits = [&](const FrameImage& unused) {
      return unused.width == width && unused.height == height;
    };
    const auto found = std::find_if(unused_.rbegin(), unused_.rend(), fits);
    if (found != unused_.rend()) {
      image = std::move(*found);
      unused_.erase(std::next(found).base());
      unused_bytes_ -= SizeBytes(image);
    }
  }
  if (image.keys.empty()) {
    image = FrameImage(width, height);
  }
  image.pool_ = shared_from_this();
  return image;
}

void FrameImagePool::Prepare(int width, int height) {
  const std::size_t plane_bytes = static_cast<std::size_t>(width) *
                                  static_cast<std::size_t>(height) *
                                  (sizeof(std::uint64_t) + sizeof(Rgba8));
  {
    const base::MutexLock lock(&mutex_);
    if (unused_bytes_ + plane_bytes > max_bytes_) {
      return;
    }
  }
  TakeBack(FrameImage(width, height));
}

void FrameImagePool::TakeBack(FrameImage image) noexcept {
  const std::size_t size = SizeBytes(image);
  if (size > max_bytes_) {
    return;
  }
  Clear(&image);
  std::vector<FrameImage> dropped;  // freed after the lock
  base::MutexLock lock(&mutex_);
  try {
    while (unused_bytes_ + size > max_bytes_) {
      const std::size_t dropped_bytes = SizeBytes(unused_.front());
      dropped.push_back(std::move(unused_.front()));
      unused_.erase(unused_.begin());
      unused_bytes_ -= dropped_bytes;
    }
    unused_.push_back(std::move(image));
    unused_bytes_ += size;
  } catch (const std::bad_alloc&) {
    // There is no memory to list this image, so it is freed.
  }
}

}  // namespace isoscope::image
