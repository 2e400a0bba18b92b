// Sources: OpenAPI Specification 3.1.0; JSON Schema 2020-12.
//
// Its server is "..", relative to the document: clients that were made from it also work below a
// path of a proxy.

#include "web-gateway/api/openapi.h"

#include <algorithm>
#include <array>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"
#include <nlohmann/json.hpp>

#include "core/base/version.h"
#include "core/cli/command_description.h"
#include "web-gateway/api/message_schema.h"
#include "web-gateway/api/render_query.h"
#include "web-gateway/api/routes.h"

namespace isoscope::gateway {
namespace {

using Json = nlohmann::ordered_json;

constexpr char kDescription[] =
    "Pictures, films, meshes and measures of isosurfaces, over HTTP. HEAD answers as GET does, "
    "without "
    "the body. JSON has the messages of proto/isoscope/v1 by protobuf's mapping: a field with its "
    "default value is left out. Views that move are a WebSocket, /v1/interact, which this document "
    "can't describe: docs/gateway.md does.";

// Names of values that are numbers, as --help has them.
constexpr std::array<absl::string_view, 3> kIntegers = {"N", "W", "H"};
constexpr std::array<absl::string_view, 5> kNumbers = {"V", "DEG", "F", "T", "PX"};

template <typename Names>
bool Contains(const Names& names, const std::string& name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

// The schema of one value.
Json ParameterSchema(const cli::FlagDescription& parameter) {
  if (parameter.value_name.empty()) {
    return {{"type", "boolean"}};
  }
  if (absl::StrJoin(parameter.choices, "|") == parameter.value_name) {
    return {{"type", "string"}, {"enum", parameter.choices}};
  }
  // The height of an orthographic camera is no count of pixels, nor need a rate be whole.
  const bool is_real =
      parameter.names[0] == "--orthographic-height" || parameter.names[0] == "--fps";
  if (is_real || Contains(kNumbers, parameter.value_name)) {
    return {{"type", "number"}};
  }
  if (Contains(kIntegers, parameter.value_name)) {
    return {{"type", "integer"}};
  }
  return {{"type", "string"}};
}

Json ParameterOf(const cli::FlagDescription& parameter) {
  const std::string form =
      parameter.value_name.empty() ? "" : absl::StrCat("\n\nForm: `", parameter.value_name, "`");
  Json json = {{"name", std::string(absl::StripPrefix(parameter.names[0], "--"))},
               {"in", "query"},
               {"description", absl::StrCat(WithoutDashes(parameter.help), form)}};
  if (parameter.value_name.empty() || parameter.has_optional_value) {
    json["allowEmptyValue"] = true;
  }
  if (parameter.is_repeatable) {
    json["style"] = "form";
    json["explode"] = true;
    json["schema"] = {{"type", "array"}, {"items", ParameterSchema(parameter)}};
  } else {
    json["schema"] = ParameterSchema(parameter);
  }
  return json;
}

Json ParametersOf(const Operation& operation) {
  Json parameters = Json::array();
  if (operation.is_of_dataset()) {
    Json name = {{"name", "name"}, {"in", "path"}, {"required", true}};
    name["description"] = "the name of a dataset, or its id";
    name["schema"]["type"] = "string";
    parameters.push_back(std::move(name));
  }
  for (const cli::FlagDescription& parameter : operation.parameters) {
    parameters.push_back(ParameterOf(parameter));
  }
  return parameters;
}

// What the headers of a picture say.
Json PictureHeaders() {
  Json headers;
  headers["X-Isoscope-Extent"]["description"] = "the size of the picture: 640x480";
  headers["X-Isoscope-Camera"]["description"] = "the camera that was used, a Camera as JSON";
  headers["X-Isoscope-Selection"]["description"] =
      "of a dataset with fields: what was drawn, a FieldSelection as JSON";
  headers["X-Isoscope-Time"]["description"] = "of a dataset with times: that of the step";
  headers["X-Isoscope-Color-Ranges"]["description"] =
      "the ranges of the colour maps, as JSON: by surface, and that of cuts";
  headers["X-Isoscope-Level"]["description"] =
      "if level or max-spacing is given: what was drawn, a DrawnLevel as JSON";
  for (auto& [name, header] : headers.items()) {
    header["schema"]["type"] = "string";
  }
  return headers;
}

Json AnswerOf(const Operation& operation, Json* schemas) {
  Json answer = {{"description", operation.summary}};
  if (operation.endpoint == Endpoint::kPicture || operation.endpoint == Endpoint::kPostedPicture) {
    answer["headers"] = PictureHeaders();
  }
  Json& content = answer["content"];
  if (operation.answer != nullptr) {
    content["application/json"]["schema"] = AddMessageSchema(*operation.answer, schemas);
  }
  for (const std::string& type : operation.media_types) {
    content[type] = Json::object();
  }
  return answer;
}

Json OperationOf(const Operation& operation, Json* schemas) {
  Json json = {{"operationId", operation.name}, {"summary", operation.summary}};
  json["parameters"] = ParametersOf(operation);
  if (operation.body != nullptr) {
    json["requestBody"]["required"] = true;
    json["requestBody"]["content"]["application/json"]["schema"] =
        AddMessageSchema(*operation.body, schemas);
  }
  json["responses"]["200"] = AnswerOf(operation, schemas);
  if (operation.endpoint == Endpoint::kPicture) {
    json["responses"]["304"]["description"] = "The picture of If-None-Match has not changed.";
  }
  json["responses"]["default"]["$ref"] = "#/components/responses/Error";
  return json;
}

// The body of every error.
Json ErrorSchema() {
  Json codes = Json::array();
  for (int code = 1; code <= static_cast<int>(absl::StatusCode::kUnauthenticated); ++code) {
    codes.push_back(absl::StatusCodeToString(static_cast<absl::StatusCode>(code)));
  }
  Json schema;
  schema["type"] = "object";
  schema["required"] = Json::array({"code", "message"});
  Json& properties = schema["properties"];
  properties["code"] = {{"type", "string"}, {"enum", std::move(codes)}};
  properties["message"]["type"] = "string";
  properties["retry_delay_ms"]["type"] = "integer";
  properties["retry_delay_ms"]["description"] =
      "when to ask again; also in the header Retry-After, in seconds";
  return schema;
}

Json SecuritySchemes() {
  Json schemes;
  schemes["bearer"] = {{"type", "http"}, {"scheme", "bearer"}};
  schemes["parameter"] = {{"type", "apiKey"}, {"in", "query"}, {"name", "token"}};
  return schemes;
}

Json MakeDocument() {
  Json schemas = Json::object();
  Json paths = Json::object();
  for (const Operation& operation : Operations()) {
    paths[operation.path][absl::AsciiStrToLower(operation.method)] =
        OperationOf(operation, &schemas);
  }
  schemas["Error"] = ErrorSchema();
  Json document;
  document["openapi"] = "3.1.0";
  document["info"]["title"] = "Isoscope gateway";
  document["info"]["version"] = std::string(base::Version());
  document["info"]["description"] = kDescription;
  document["info"]["license"] = {{"name", "Apache-2.0"}, {"identifier", "Apache-2.0"}};
  document["servers"][0]["url"] = "..";
  // Any of three; a gateway without a token ignores what is shown.
  document["security"][0] = Json::object();
  document["security"][1]["bearer"] = Json::array();
  document["security"][2]["parameter"] = Json::array();
  document["paths"] = std::move(paths);
  Json& components = document["components"];
  components["schemas"] = std::move(schemas);
  components["responses"]["Error"]["description"] = "What is wrong, where, and what is allowed.";
  components["responses"]["Error"]["content"]["application/json"]["schema"]["$ref"] =
      "#/components/schemas/Error";
  components["securitySchemes"] = SecuritySchemes();
  return document;
}

}  // namespace

const std::string& OpenApiDocument() {
  static const std::string document = absl::StrCat(MakeDocument().dump(), "\n");
  return document;
}

}  // namespace isoscope::gateway
