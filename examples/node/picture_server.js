// A web back end with one endpoint: GET /DATASET.png?isovalue=60&width=800 -> the exact picture.
//
//   npm install && npm start -- [HOST:PORT of the coordinator] [PORT to listen on]
//
// $ISOSCOPE_TOKEN is the token that the coordinator gets, where it wants one.

import http from 'node:http';
import grpc from '@grpc/grpc-js';
import { loadSync } from '@grpc/proto-loader';

const [server = 'localhost:50051', port = '8000'] = process.argv.slice(2);
const protos = new URL('../../proto', import.meta.url).pathname;
const options = { longs: Number, enums: String, defaults: true, includeDirs: [protos] };
const { isoscope } = grpc.loadPackageDefinition(loadSync('isoscope/v1/isosurface_service.proto', options));
// Pictures come in parts: no limit of messages is in the way.
const client = new isoscope.v1.IsosurfaceService(server, grpc.credentials.createInsecure());
const metadata = new grpc.Metadata();
if (process.env.ISOSCOPE_TOKEN) metadata.set('authorization', `Bearer ${process.env.ISOSCOPE_TOKEN}`);
const statuses = { [grpc.status.INVALID_ARGUMENT]: 400, [grpc.status.NOT_FOUND]: 404,
  [grpc.status.RESOURCE_EXHAUSTED]: 429, [grpc.status.UNAVAILABLE]: 503 };

http.createServer((request, response) => {
  const url = new URL(request.url, 'http://localhost');
  const number = (name, value) => Number(url.searchParams.get(name) ?? value);
  const dataset = decodeURIComponent(url.pathname.slice(1).replace(/\.png$/, ''));
  const viewport = { widthPx: number('width', 800), heightPx: number('height', 600) };
  const frame = { dataset, isovalue: number('isovalue', 0), viewport };
  const call = client.renderIsosurfaceStream({ request: frame }, metadata, { deadline: Date.now() + 60_000 });
  const parts = [];
  call.on('data', ({ part }) => parts.push(part.png));
  call.on('error', ({ code, details }) => response.writeHead(statuses[code] ?? 500).end(`${details}\n`));
  call.on('end', () => parts.length && response.writeHead(200, { 'Content-Type': 'image/png' }).end(Buffer.concat(parts)));
  response.on('close', () => call.cancel());
}).listen(Number(port), '127.0.0.1', function () {
  console.log(`http://127.0.0.1:${this.address().port}/DATASET.png?isovalue=V of ${server}`);
});
