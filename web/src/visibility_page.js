import { unpackText } from "./arrays.js";
import { mount } from "./visibility.js";

const text = document.getElementById("data").textContent.trim();
unpackText(text).then(
  (data) => {
    window.cyclorama = mount(document.getElementById("view"), data);
  },
  (error) => {
    document.getElementById("view").textContent = `This page cannot be shown: ${error.message}`;
  },
);
