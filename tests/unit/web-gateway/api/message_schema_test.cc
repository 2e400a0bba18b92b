#include "web-gateway/api/message_schema.h"

#include <string>

#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

#include "isoscope/v1/cluster_service.pb.h"
#include "isoscope/v1/dataset_service.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::gateway {
namespace {

namespace v1 = isoscope::v1;
using Json = nlohmann::ordered_json;

// Adds a member of each reference below `json` to `names`.
void CollectReferences(const Json& json, Json* names) {
  for (const auto& [key, value] : json.items()) {
    if (key == "$ref") {
      (*names)[value.get<std::string>()] = true;
    } else if (value.is_structured()) {
      CollectReferences(value, names);
    }
  }
}

TEST(MessageSchemaTest, EachTypeIsThatOfTheJsonMapping) {
  Json schemas = Json::object();
  EXPECT_EQ(AddMessageSchema(*v1::RenderIsosurfaceRequest::descriptor(), &schemas)["$ref"],
            "#/components/schemas/RenderIsosurfaceRequest");
  const Json& request = schemas["RenderIsosurfaceRequest"]["properties"];
  EXPECT_EQ(request["raySeed"]["type"], "string");  // int64
  EXPECT_EQ(request["maxLayers"]["type"], "integer");
  EXPECT_EQ(request["withNotes"]["type"], "boolean");
  EXPECT_EQ(request["isovalue"]["oneOf"][0]["type"], "number");
  EXPECT_EQ(request["isovalue"]["oneOf"][1]["enum"][0], "NaN");
  EXPECT_EQ(request["surfaces"]["type"], "array");
  EXPECT_EQ(request["surfaces"]["items"]["$ref"], "#/components/schemas/Surface");
  EXPECT_EQ(request["culling"]["$ref"], "#/components/schemas/Culling");
  EXPECT_EQ(schemas["Culling"]["enum"][0], "CULLING_UNSPECIFIED");
  AddMessageSchema(*v1::RenderIsosurfaceResponse::descriptor(), &schemas);
  EXPECT_EQ(schemas["RenderIsosurfaceResponse"]["properties"]["png"]["contentEncoding"], "base64");
  AddMessageSchema(*v1::GetClusterStatusResponse::descriptor(), &schemas);
  EXPECT_EQ(schemas["CoordinatorLoad"]["properties"]["upDuration"]["type"], "string");
  EXPECT_FALSE(schemas.contains("Duration"));
}

TEST(MessageSchemaTest, WhatIsInsideAMessageKeepsItsName) {
  EXPECT_EQ(SchemaName(*v1::Dataset::descriptor()), "Dataset");
  Json schemas = Json::object();
  AddMessageSchema(*v1::OutputOptions::descriptor(), &schemas);
  EXPECT_EQ(schemas["OutputOptions"]["properties"]["imageFormat"]["$ref"],
            "#/components/schemas/OutputOptions.ImageFormat");
}

TEST(MessageSchemaTest, NoReferenceIsOpen) {
  Json schemas = Json::object();
  for (const auto* message :
       {v1::RenderIsosurfaceRequest::descriptor(), v1::GetClusterStatusResponse::descriptor(),
        v1::ListDatasetsResponse::descriptor(), v1::PickSurfaceResponse::descriptor()}) {
    AddMessageSchema(*message, &schemas);
  }
  Json references = Json::object();
  CollectReferences(schemas, &references);
  EXPECT_GT(references.size(), 10U);
  for (const auto& [reference, found] : references.items()) {
    EXPECT_TRUE(schemas.contains(reference.substr(std::string("#/components/schemas/").size())))
        << reference;
  }
}

}  // namespace
}  // namespace isoscope::gateway
