// The document against the table that requests are answered by. Against real answers:
// tests/integration/openapi_test.py.

#include "web-gateway/api/openapi.h"

#include <cstddef>
#include <string>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

#include "tests/support/status_matchers.h"
#include "web-gateway/api/render_query.h"
#include "web-gateway/api/routes.h"

namespace isoscope::gateway {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;
using Json = nlohmann::ordered_json;

Json Document() { return Json::parse(OpenApiDocument()); }

Json OperationAt(const Json& document, const Operation& operation) {
  return document["paths"][operation.path][absl::AsciiStrToLower(operation.method)];
}

// The parameters of the query, by name.
Json ParametersOf(const Json& operation) {
  Json parameters = Json::object();
  for (const Json& parameter : operation["parameters"]) {
    if (parameter["in"] == "query") {
      parameters[parameter["name"].get<std::string>()] = parameter;
    }
  }
  return parameters;
}

TEST(OpenApiTest, ItHasEachOperationAndNoOther) {
  const Json document = Document();
  EXPECT_EQ(document["openapi"], "3.1.0");
  std::size_t count = 0;
  for (const auto& [path, methods] : document["paths"].items()) {
    count += methods.size();
  }
  EXPECT_EQ(count, Operations().size());
  for (const Operation& operation : Operations()) {
    const Json json = OperationAt(document, operation);
    EXPECT_EQ(json["operationId"], operation.name);
    EXPECT_EQ(json.contains("requestBody"), operation.body != nullptr) << operation.name;
    EXPECT_FALSE(json["responses"]["200"]["content"].empty()) << operation.name;
    EXPECT_EQ(ParametersOf(json).size(), operation.parameters.size()) << operation.name;
  }
}

// A parameter that the document forgets, or has too much, is one that a client can't use.
TEST(OpenApiTest, TheParametersOfAPictureAreThoseThatAreRead) {
  const Json parameters = ParametersOf(Document()["paths"]["/v1/datasets/{name}/render"]["get"]);
  for (const auto& [name, parameter] : parameters.items()) {
    const absl::Status status =
        PictureQueryFromQuery({{name, "\x01 no value"}}, isoscope::v1::Dataset()).status();
    EXPECT_THAT(std::string(status.message()), Not(HasSubstr("no parameter"))) << name;
    EXPECT_THAT(parameter["description"].get<std::string>(), Not(StartsWith("--"))) << name;
    EXPECT_GT(parameter["description"].get<std::string>().size(), 10U) << name;
  }
  const absl::Status unknown =
      PictureQueryFromQuery({{"none", "1"}}, isoscope::v1::Dataset()).status();
  for (const auto& [name, parameter] : parameters.items()) {
    EXPECT_THAT(std::string(unknown.message()), HasSubstr(name));
  }
}

TEST(OpenApiTest, TypesAreThoseThatTheReadersTake) {
  const Json parameters = ParametersOf(Document()["paths"]["/v1/datasets/{name}/render"]["get"]);
  EXPECT_EQ(parameters["isovalue"]["schema"]["type"], "number");
  EXPECT_EQ(parameters["width"]["schema"]["type"], "integer");
  EXPECT_EQ(parameters["orthographic-height"]["schema"]["type"], "number");
  EXPECT_EQ(parameters["axes"]["schema"]["type"], "boolean");
  EXPECT_TRUE(parameters["axes"]["allowEmptyValue"].get<bool>());
  EXPECT_EQ(parameters["surface"]["schema"]["type"], "array");
  EXPECT_EQ(parameters["culling"]["schema"]["enum"], Json::array({"depth", "mask", "none"}));
  EXPECT_EQ(parameters["step"]["schema"]["type"], "string") << "a number, first or last";
  EXPECT_FALSE(parameters["color-by"]["schema"]["items"].contains("enum")) << "a field of any name";
  // What is called a number refuses text, and what has choices takes each of them.
  for (const auto& [name, parameter] : parameters.items()) {
    const Json& schema = parameter["schema"];
    if (schema["type"] == "number" || schema["type"] == "integer") {
      EXPECT_THAT(PictureQueryFromQuery({{name, "x"}}, isoscope::v1::Dataset()).status(),
                  testing::StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("'x'")))
          << name;
    }
    if (schema.contains("enum")) {
      for (const Json& choice : schema["enum"]) {
        const absl::Status status =
            PictureQueryFromQuery({{"isovalue", "1"}, {name, choice.get<std::string>()}},
                                  isoscope::v1::Dataset())
                .status();
        EXPECT_THAT(std::string(status.message()), Not(HasSubstr("is none of")))
            << name << " " << choice;
      }
    }
  }
}

TEST(OpenApiTest, AFilmTakesRangesAndRatesThatAreNotWhole) {
  const Json parameters = ParametersOf(Document()["paths"]["/v1/datasets/{name}/film.webp"]["get"]);
  EXPECT_EQ(parameters["isovalue"]["schema"]["type"], "string") << "a number, or A:B:STEP";
  EXPECT_EQ(parameters["step"]["schema"]["type"], "string");
  EXPECT_EQ(parameters["repeat"]["schema"]["type"], "integer");
  EXPECT_EQ(parameters["orbit"]["schema"]["type"], "number");
  EXPECT_EQ(parameters["fps"]["schema"]["type"], "number");
  for (const char* const none : {"format", "quality", "record"}) {
    EXPECT_FALSE(parameters.contains(none)) << none;
  }
}

TEST(OpenApiTest, TheDocumentIsTheSameForOneVersion) {
  EXPECT_EQ(OpenApiDocument(), OpenApiDocument());
  EXPECT_TRUE(Document()["info"]["version"].is_string());
}

}  // namespace
}  // namespace isoscope::gateway
