// What the coordinator can do, as it says itself; older gateways do not tell.
// @ts-check

import { client } from './page-view.js';

/** @type {{version: string, features: string[], gatewayAddress: string}} texts: '' until they are known */
export const abilities = { version: '', features: [], gatewayAddress: '' };

/** A gateway that does not know its coordinator's abilities still shows pictures. */
export async function loadAbilities() {
  try {
    const { version = '', features = [], gatewayAddress = '' } = await client.get('v1/capabilities');
    Object.assign(abilities, { version, features, gatewayAddress });
  } catch {
    // The datasets, which are asked for besides, report what is wrong.
  }
}

/** @type {Promise<boolean> | null} */
let isWebpFound = null;

/**
 * Whether this gateway has pictures as WebP: by the document of its interface, which is asked for once.
 * @returns {Promise<boolean>}
 */
export async function findWebp() {
  isWebpFound ??= client.get('v1/openapi.json').then(({ paths }) =>
    'image/webp' in paths['/v1/datasets/{name}/render'].get.responses['200'].content).catch(() => false);
  return isWebpFound;
}
