// An island whose painting is a state of a React component. React 19 passes attributes and events (`onapplied`)
// to custom elements.

import { useState } from "react";
import { createRoot } from "react-dom/client";

const PAINTINGS = ["ink", "dots", "mosaic"];

function Island() {
  const [painting, setPainting] = useState("ink");
  const [text, setText] = useState("loading …");
  return (
    <>
      <h1>An island in {painting}</h1>
      <styled-splats
        src="../../assets/demo.sgs"
        painting={`../../assets/styles/${painting}.jpg`}
        onprogress={({ detail }) => setText(`${detail.task} …`)}
        onapplied={({ detail }) => setText(`${painting}: ${detail.milliseconds} ms`)}
        onfailed={({ detail }) => setText(detail.message)}
      />
      <p>
        {PAINTINGS.map((name) => (
          <button key={name} id={name} onClick={() => setPainting(name)}>{name}</button>
        ))}
        <span id="status" role="status">{text}</span>
      </p>
    </>
  );
}

createRoot(document.getElementById("root")).render(<Island />);
