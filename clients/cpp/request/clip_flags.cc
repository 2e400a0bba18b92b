#include "clients/cpp/request/clip_flags.h"

#include "absl/strings/str_cat.h"

#include "core/cli/flags.h"
#include "core/cli/usage.h"
#include "core/view/clip_region.h"
#include "wire/proto_convert.h"

namespace isoscope::client {

void AddClipFlags(cli::FlagSet* set, ClipFlags* flags, const std::string& verb) {
  cli::AddRepeatableFlag(
      set, "--clip-plane", "NX,NY,NZ,D", &flags->planes, ParsePlane,
      verb + " only the points p with N . p >= D, in world units; up to 6 times");
  cli::AddFlag(set, "--clip-box", "X0,X1,Y0,Y1,Z0,Z1", &flags->box, ParseBox,
               verb + " only what is in this box, in world units");
}

absl::Status CheckUsage(const ClipFlags& flags) {
  if (flags.planes.size() > view::kMaxHalfSpaces) {
    return cli::UsageError(absl::StrCat("--clip-plane is given ", flags.planes.size(),
                                        " times: at most ", view::kMaxHalfSpaces, " are allowed"));
  }
  return absl::OkStatus();
}

isoscope::v1::ClipRegion ToProto(const ClipFlags& flags) {
  isoscope::v1::ClipRegion region;
  for (const PlaneValue& plane : flags.planes) {
    isoscope::v1::HalfSpace* const proto = region.add_half_spaces();
    *proto->mutable_normal() = wire::ToProto(plane.normal);
    proto->set_offset(plane.offset);
  }
  if (flags.box) {
    *region.mutable_box()->mutable_min() = wire::ToProto(flags.box->min);
    *region.mutable_box()->mutable_max() = wire::ToProto(flags.box->max);
  }
  return region;
}

}  // namespace isoscope::client
