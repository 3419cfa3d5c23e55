import { unpack } from "./arrays.js";
import { mount } from "./visibility.js";

function render({ model, el }) {
  const bytes = model.get("data");
  const copy = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength);
  el.style.height = `${model.get("height")}px`;
  const view = mount(el, unpack(copy));
  const look = () => view.look(model.get("direction"));
  model.on("change:direction", look);
  return () => {
    model.off("change:direction", look);
    view.dispose();
  };
}

export default { render };
