// Pages of a list that is sorted by name: the datasets, the agents. A token holds the last name of
// the page before it, so names that come or go meanwhile do not shift the pages.

#ifndef ISOSCOPE_SERVER_PAGE_H_
#define ISOSCOPE_SERVER_PAGE_H_

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::server {

// Decides which names of a list are on a page. The caller offers all names in ascending order.
class Page {
 public:
  // list:  one word that differs between lists, so that a token is valid for its own list only
  // size:  0: all
  // token: "" for the first page, else next_token() of the page before
  // INVALID_ARGUMENT: a negative size, or a token of another list.
  static absl::StatusOr<Page> Make(absl::string_view list, std::int32_t size,
                                   absl::string_view token);

  // Returns true if this name is on the page.
  bool Offer(absl::string_view name);
  // The token of the next page; "" if no name was left over.
  [[nodiscard]] std::string next_token() const;

 private:
  Page(absl::string_view list, std::size_t size, std::string after)
      : list_(list), size_(size), after_(std::move(after)) {}

  std::string list_;
  std::size_t size_;
  std::string after_;  // the last name of the pages so far
  std::size_t count_ = 0;
  bool is_more_ = false;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_PAGE_H_
