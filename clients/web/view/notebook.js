// The view in a cell of a notebook: an anywidget module.
// @ts-check

import { mount } from './view.js';

/** @typedef {import('./connection.js').Transport} Transport */

/**
 * @typedef {{get: (name: string) => any, set: (name: string, value: any) => void, save_changes: () => void,
 *   on: (event: string, handler: (...args: any[]) => void) => void,
 *   off: (event: string, handler: (...args: any[]) => void) => void,
 *   send: (message: any) => void}} Model
 */

/**
 * Frames through the kernel of a notebook: {type: 'isoscope/interact', text} there, {type:
 * 'isoscope/frame'} with one buffer back, with the content of the WebSocket's messages.
 * @param {Model} model @returns {Transport}
 */
function kernelTransport(model) {
  /** @type {((message: any, buffers: any[]) => void) | null} */
  let handler = null;
  return {
    name: 'kernel',
    open(receive) {
      handler = (message, buffers) => {
        if (message?.type === 'isoscope/frame' && buffers?.length > 0) {
          const view = buffers[0];
          receive(view instanceof ArrayBuffer ? view
            : view.buffer.slice(view.byteOffset, view.byteOffset + view.byteLength));
        }
      };
      model.on('msg:custom', handler);
      model.send({ type: 'isoscope/open' });
    },
    send(text) { model.send({ type: 'isoscope/interact', text }); },
    close() {
      if (handler) {
        model.off('msg:custom', handler);
        model.send({ type: 'isoscope/close' });
        handler = null;
      }
    },
  };
}

/**
 * The module that anywidget loads. Traits: `url`, `token`, `state` (both ways), `height` (CSS), `stats`
 * and `picked` (from here).
 */
export default {
  /** @param {{model: Model, el: HTMLElement}} context */
  render({ model, el }) {
    const box = document.createElement('div');
    box.style.height = typeof model.get('height') === 'number' ? `${model.get('height')}px` : model.get('height') || '480px';
    box.style.position = 'relative';
    const pill = document.createElement('div');
    Object.assign(pill.style, { position: 'absolute', top: '8px', right: '8px', font: '11px system-ui, sans-serif',
      padding: '2px 8px', borderRadius: '9px', color: '#dbe4f0', background: 'rgba(22,28,38,.7)', pointerEvents: 'none',
      zIndex: '1' });
    el.append(box);
    const state = model.get('state') ?? {};
    const view = mount(box, { url: model.get('url') || undefined, token: model.get('token') || undefined, state,
      wheel: 'focused', transport: kernelTransport(model) });
    box.append(pill);
    let last = JSON.stringify(state);
    const onState = () => {
      const next = model.get('state') ?? {};
      if (JSON.stringify(next) !== last) {
        last = JSON.stringify(next);
        view.setState(next);
      }
    };
    model.on('change:state', onState);
    const tell = () => {
      const stats = view.stats();
      const kind = stats.isExact && stats.isScaled ? 'scaled' : view.pictureText || 'moving';
      pill.textContent = `${kind} · ${stats.transport}`;
    };
    view.addEventListener('refined', tell);
    view.addEventListener('frame', (event) => {
      const { isExact } = /** @type {CustomEvent} */ (event).detail;
      tell();
      if (isExact) {
        const current = view.getState();
        last = JSON.stringify(current);
        model.set('state', current);
        model.set('stats', view.stats());
        model.save_changes();
      }
    });
    view.addEventListener('click', (event) => {
      model.set('picked', /** @type {CustomEvent} */ (event).detail);
      model.save_changes();
    });
    return () => {
      model.off('change:state', onState);
      view.destroy();
    };
  },
};
