#include "core/image/pixel_mailboxes.h"

#include <utility>

namespace isoscope::image {

std::shared_ptr<PixelMailboxes> PixelMailboxes::Make() {
  return std::shared_ptr<PixelMailboxes>(new PixelMailboxes());
}

std::unique_ptr<PixelMailboxes::Mailbox> PixelMailboxes::Open() {
  std::int64_t number = 0;
  {
    const base::MutexLock lock(&mutex_);
    number = ++last_number_;
    open_[number];
  }
  return std::make_unique<Mailbox>(shared_from_this(), number);
}

bool PixelMailboxes::Put(std::int64_t number, DrawnPixels pixels) {
  const base::MutexLock lock(&mutex_);
  const auto mailbox = open_.find(number);
  if (mailbox == open_.end()) {
    return false;
  }
  mailbox->second.push_back(std::move(pixels));
  return true;
}

std::optional<DrawnPixels> PixelMailboxes::Take(std::int64_t number) {
  const base::MutexLock lock(&mutex_);
  const auto mailbox = open_.find(number);
  if (mailbox == open_.end() || mailbox->second.empty()) {
    return std::nullopt;
  }
  DrawnPixels pixels = std::move(mailbox->second.front());
  mailbox->second.pop_front();
  return pixels;
}

void PixelMailboxes::Close(std::int64_t number) {
  std::deque<DrawnPixels> dropped;  // cleared after the lock
  const base::MutexLock lock(&mutex_);
  const auto mailbox = open_.find(number);
  if (mailbox != open_.end()) {
    dropped = std::move(mailbox->second);
    open_.erase(mailbox);
  }
}

}  // namespace isoscope::image
