#include "server/interact/interact_service_impl.h"

#include "core/rpc/known_fields.h"

namespace isoscope::server {

InteractServiceImpl::InteractServiceImpl(const InteractServiceOptions& options)
    : options_(options) {
  rpc::PrepareKnownFields(isoscope::v1::InteractRequest());
}

}  // namespace isoscope::server
