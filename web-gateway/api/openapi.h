// The OpenAPI 3.1 document of the HTTP interface, made from the table of operations.

#ifndef ISOSCOPE_WEB_GATEWAY_API_OPENAPI_H_
#define ISOSCOPE_WEB_GATEWAY_API_OPENAPI_H_

#include <string>

namespace isoscope::gateway {

// Returns the document as JSON; the same text for one version of the program. Thread-safe.
const std::string& OpenApiDocument();

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_API_OPENAPI_H_
