// The cost of frames: steps over time, agents, figures; and agents that do not answer.
// @ts-check

import { make, page, quietly, svg } from './elements.js';
import { say } from './messages.js';
import { client } from './page-view.js';
import { format, formatBytes, milliseconds } from './values.js';

/** @type {number[][]} */
const recentSteps = [];
const STEPS = ['occluderSelectionDuration', 'occluderRenderingDuration', 'visibilityCullingDuration', 'compositeDuration', 'encodeDuration'];

/** @param {any} statistics */
export function addCost(statistics) {
  recentSteps.push(STEPS.map((name) => milliseconds(statistics.durations?.[name] ?? '0')));
  recentSteps.splice(0, Math.max(0, recentSteps.length - 120));
  drawCost(statistics);
}

/** @param {any[]} agents */
function drawAgents(agents) {
  const longest = Math.max(1, ...agents.map((/** @type {any} */ agent) => milliseconds(agent.busyDuration ?? '0')));
  page.agents.replaceChildren(...agents.map((/** @type {any} */ agent) => {
    const extract = milliseconds(agent.extractDuration ?? '0');
    const draw = milliseconds(agent.renderDuration ?? '0');
    const busy = milliseconds(agent.busyDuration ?? '0');
    const bars = svg('svg', { viewBox: '0 0 100 9', preserveAspectRatio: 'none' });
    let x = 0;
    for (const [value, name] of /** @type {[number, string][]} */ ([[extract, 'extract'], [draw, 'draw'], [Math.max(0, busy - extract - draw), 'rest']])) {
      bars.append(svg('rect', { class: name, x, y: 0, width: 100 * value / longest, height: 9 }));
      x += 100 * value / longest;
    }
    return make('div', { className: 'agent', title: `${agent.agentAddress}: shards ${(agent.shardIndices ?? []).join(', ')}; ` +
      `${Number(agent.triangleCount ?? 0).toLocaleString('en')} triangles, ${formatBytes(Number(agent.readBytes ?? 0))} read` },
    make('span', {}, agent.agentAddress), bars, make('b', {}, `${format(busy, 3)} ms`));
  }), make('div', { className: 'key' }, ...['extract', 'draw', 'rest'].map((name) => make('span', {}, make('i', { className: name }), name))));
}

const drawCost = quietly((/** @type {any} */ statistics) => {
  const canvas = page.times;
  const ratio = devicePixelRatio || 1;
  const width = canvas.clientWidth;
  const height = canvas.clientHeight;
  canvas.width = width * ratio;
  canvas.height = height * ratio;
  const context = canvas.getContext('2d');
  if (context) {
    context.scale(ratio, ratio);
    const style = getComputedStyle(document.documentElement);
    const colors = ['--warn', '--accent', '--bars', '--good', '--quiet'].map((name) => style.getPropertyValue(name));
    const totals = recentSteps.map((one) => one.reduce((a, b) => a + b, 0));
    const top = Math.max(10, ...totals) * 1.15;
    recentSteps.forEach((one, i) => {
      let y = height;
      one.forEach((value, k) => {
        const tall = value / top * height;
        context.fillStyle = colors[k];
        context.fillRect(width - (recentSteps.length - i) * (width / 120), y - tall, Math.max(1, width / 120 - 0.6), tall);
        y -= tall;
      });
    });
    context.fillStyle = style.getPropertyValue('--quiet');
    context.font = '10px system-ui, sans-serif';
    context.fillText(`${format(totals.at(-1) ?? 0, 3)} ms a frame, by step`, 7, 13);
  }
  if (statistics.agents) {  // a moving frame has none: the agents of the last exact one stay
    drawAgents(statistics.agents);
  }
  const count = (/** @type {any} */ value) => Number(value ?? 0).toLocaleString('en');
  const bands = Number(statistics.bandCount ?? 0);
  const unresolved = Number(statistics.unresolvedBlockCount ?? 0);
  const figures = [...(unresolved > 0 ? [['Not resolved at this level', `${count(unresolved)} blocks`]] : []), ...(bands > 1 ? [['Bands, for memory', count(bands)]] : []), ['Triangles', count(statistics.triangleCount)], ['Active blocks', count(statistics.activeBlockCount)],
    ['Drawn · culled', `${count(statistics.visibleBlockCount)} · ${count(statistics.culledBlockCount)}`],
    ['Read from disk', formatBytes(Number(statistics.readBytes ?? 0))], ['Between servers', formatBytes(Number(statistics.networkBytes ?? 0))]];
  page.figures.replaceChildren(...figures.flatMap(([name, value]) => [make('dt', {}, name), make('dd', {}, value)]));
});

export async function watchAgents() {
  try {
    const { agents = [] } = await client.get('v1/status');
    const lost = agents.filter((/** @type {any} */ agent) => agent.state === 'STATE_UNREACHABLE');
    const text = lost.map((/** @type {any} */ agent) => `${agent.address} does not answer: ${agent.message || 'no reason given'}`).join('\n');
    if (text && text !== watchedProblem) {
      say(text, true);
    }
    watchedProblem = text;
  } catch {
    // The view reports that the gateway is unreachable.
  }
}
let watchedProblem = '';
